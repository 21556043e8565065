"""The host as NMT master: starts the nodes, sends its heartbeat and monitors theirs (CiA 301, 7.2.8).

Pure: frames and times in, frames out. Every known node is reset once at the start, so that none keeps a state
set by another master. A node without a boot-up or heartbeat is reset again every second.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.nmt import NmtCommand, NmtState

NMT_ID = 0x000
SYNC = CanFrame(0x080)
TIME_STAMP_ID = 0x1FF  # 1013h; every fingertip's RPDO 1
HEARTBEAT_ID = 0x700
EMCY_ID = 0x080

RESET_AGAIN_US = 1_000_000
START_AGAIN_US = 200_000
TIME_STAMP_EVERY_US = 50_000


def nmt(command: NmtCommand, node_id: int) -> CanFrame:
    """Return the NMT frame for one node."""
    return CanFrame(NMT_ID, bytes((command, node_id)))


def foreign_stop(frame: CanFrame, host_node: int) -> bool:
    """Return whether another master stops all nodes or this host: an operator's stop by NMT.

    The host commands its nodes one by one, so its own frames never match.
    """
    if frame.can_id != NMT_ID or len(frame.data) != 2:
        return False
    command, node_id = frame.data
    return node_id in (0, host_node) and command != NmtCommand.START


class TimeStampProducer:
    """Producer of the bus clock: 1013h carries the time of the last SYNC in us, modulo 2^32 (CiA 301).

    `sync_left` takes the interface's time stamp of the host's own SYNC on the wire. The time at which the
    SYNC was handed to the driver would not include its wait for the bus.
    """

    def __init__(self) -> None:
        self._left_us: list[int] = []
        self._next_us: int | None = None

    def sync_left(self, stamp_us: int) -> None:
        """Take the time stamp of the host's own SYNC on the bus."""
        self._left_us.append(stamp_us)

    def due(self, tick_us: int) -> list[CanFrame]:
        """Return the time stamp of the last SYNC before this tick, every `TIME_STAMP_EVERY_US`."""
        left_us = [stamp_us for stamp_us in self._left_us if stamp_us < tick_us]
        if not left_us:
            return []
        self._left_us = [stamp_us for stamp_us in self._left_us if stamp_us >= tick_us]
        if self._next_us is not None and tick_us < self._next_us:
            return []
        self._next_us = tick_us + TIME_STAMP_EVERY_US
        return [CanFrame(TIME_STAMP_ID, (left_us[-1] & 0xFFFF_FFFF).to_bytes(4, "little"))]


class Network:
    """The nodes of the hand with their NMT states and heartbeats."""

    def __init__(self, names: Mapping[int, str], host_node: int, heartbeat_us: int, timeout_us: int) -> None:
        self._names = dict(names)
        self._host_node = host_node
        self._heartbeat_us = heartbeat_us
        self._timeout_us = timeout_us
        self._last_heartbeat_us: dict[int, int] = {}
        self._state: dict[int, int] = {}
        self._reset_us: dict[int, int] = {}
        self._started_us: dict[int, int] = {}
        self._woken_us: dict[int, int] = {}
        self._next_heartbeat_us: int | None = None

    def receive(self, stamp_us: int, frame: CanFrame) -> int | None:
        """Take a heartbeat; return the node id if it is a boot-up. A frame must have 1 byte."""
        node_id = frame.can_id - HEARTBEAT_ID
        # The reset may wait in the transmit queue when the loop starts: heartbeats before it do not count.
        if node_id not in self._reset_us or len(frame.data) != 1:
            return None
        state = frame.data[0] & 0x7F
        self._last_heartbeat_us[node_id] = stamp_us
        self._state[node_id] = state
        if state != NmtState.INITIALISING:
            return None
        self._state[node_id] = NmtState.PRE_OPERATIONAL
        self._started_us.pop(node_id, None)
        return node_id

    def due(self, now_us: int, ready: Collection[int]) -> list[CanFrame]:
        """Return the host's heartbeat, resets of nodes without one, and starts of those in `ready`.

        A stopped node that is not ready becomes pre-operational, since it answers no SDO request.
        """
        frames: list[CanFrame] = []
        if self._next_heartbeat_us is None or now_us >= self._next_heartbeat_us:
            self._next_heartbeat_us = now_us + self._heartbeat_us
            frames.append(CanFrame(HEARTBEAT_ID + self._host_node, bytes((NmtState.OPERATIONAL,))))
        for node_id in self._names:
            if node_id not in self._last_heartbeat_us:
                if now_us >= self._reset_us.get(node_id, now_us - RESET_AGAIN_US) + RESET_AGAIN_US:
                    self._reset_us[node_id] = now_us
                    frames.append(nmt(NmtCommand.RESET_COMMUNICATION, node_id))
            elif node_id in ready and not self.operates(node_id) and self._may_start(node_id, now_us):
                self._started_us[node_id] = now_us
                frames.append(nmt(NmtCommand.START, node_id))
            elif node_id not in ready and self._is_stopped(node_id) and self._may_wake(node_id, now_us):
                self._woken_us[node_id] = now_us
                frames.append(nmt(NmtCommand.ENTER_PRE_OPERATIONAL, node_id))
        return frames

    def _may_start(self, node_id: int, now_us: int) -> bool:
        return now_us >= self._started_us.get(node_id, now_us - START_AGAIN_US) + START_AGAIN_US

    def _may_wake(self, node_id: int, now_us: int) -> bool:
        return now_us >= self._woken_us.get(node_id, now_us - START_AGAIN_US) + START_AGAIN_US

    def _is_stopped(self, node_id: int) -> bool:
        return self._state.get(node_id) == NmtState.STOPPED

    def stop_all(self) -> list[CanFrame]:
        """Return NMT stop for each node of the hand, one by one: the bus may have other nodes."""
        return [nmt(NmtCommand.STOP, node_id) for node_id in self._names]

    def is_up(self, node_id: int) -> bool:
        """Return whether the node has sent a heartbeat since its reset."""
        return node_id in self._last_heartbeat_us

    def operates(self, node_id: int) -> bool:
        """Return whether the node is operational."""
        return self._state.get(node_id) == NmtState.OPERATIONAL

    def restart(self) -> None:
        """Reset and start every node again."""
        known_of_nodes = (
            self._last_heartbeat_us,
            self._state,
            self._reset_us,
            self._started_us,
            self._woken_us,
        )
        for known in known_of_nodes:
            known.clear()

    def missing(self) -> list[str]:
        """Return the names of the nodes without a heartbeat since their reset."""
        return [self.name(node_id) for node_id in self._names if node_id not in self._last_heartbeat_us]

    def heartbeat_timed_out(self, node_id: int, now_us: int) -> bool:
        """Return whether the node's heartbeat has timed out after it was received at least once."""
        last_us = self._last_heartbeat_us.get(node_id)
        return last_us is not None and now_us - last_us > self._timeout_us

    def name(self, node_id: int) -> str:
        """Return name and id of a node for messages."""
        return f"{self._names[node_id]} (node 0x{node_id:02X})"

    def not_operating(self) -> list[int]:
        """Return the nodes that are not operational yet."""
        return [node_id for node_id in self._names if not self.operates(node_id)]
