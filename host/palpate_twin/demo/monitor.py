"""Monitor of the running demo: a listener on the bus, the host's status stream and the hub's counters.

`poll` reads what has arrived and never blocks, so monitoring takes little processor time.
"""

from __future__ import annotations

import contextlib
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from types import TracebackType

import msgspec

from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics, Statistics
from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.nmt import NmtState
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.network.fingertips import Fingertip
from palpate_host.network.nmt_master import HEARTBEAT_ID

LATENCY_WINDOW_US = 1_000_000
STATISTICS_PERIOD_US = 500_000
CHUNK_BYTES = 256 * 1024


@dataclass(frozen=True, slots=True)
class MonitorSample:
    """State of the running hand at one poll.

    status: newest status of the host, None before the first. latency_us: per finger, median over the last
    second from exposure to the arbitration of the contact's last CAN frame; None without frames. load: share
    of the bit rate in use.
    """

    status: HostStatus | None
    latency_us: tuple[float | None, ...]
    load: float | None


class Monitor:
    """Listener on the hub of `hand.bus` and on `status_socket`, to which the host connects."""

    def __init__(
        self,
        hand: HandConfig,
        status_socket: Path,
        now_us: Callable[[], int],
        on_status: Callable[[HostStatus], None] = lambda _status: None,
    ) -> None:
        """Connect to the hub. Raises BusError without a hub.

        now_us: returns Unix time on the bus's clock. on_status: called for each status.
        """
        self._on_status = on_status
        self._now_us = now_us
        self._hub = Path(hand.bus.channel)
        fd = hand.bus.data_bitrate is not None
        self._fingertips = [Fingertip(finger.fingertip_node, finger.name, fd=fd) for finger in hand.fingers]
        self._finger_of = {
            can_id: index for index, tip in enumerate(self._fingertips) for can_id in tip.receive_ids
        }
        self._latencies: list[deque[tuple[int, int]]] = [deque() for _ in self._fingertips]
        self.not_booted = dict(hand.node_names)
        self._load: float | None = None
        self._statistics_us: int | None = None
        self._decoder = msgspec.json.Decoder(HostStatus)
        self._partial_line = b""
        self._status: HostStatus | None = None
        self._stream: socket.socket | None = None
        boot_ups = [HEARTBEAT_ID + node for node in hand.node_names]
        with contextlib.ExitStack() as undo:
            self._bus = undo.enter_context(open_bus(hand.bus, "demo", [*boot_ups, *self._finger_of]))
            self._listener = undo.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            self._listener.setblocking(False)
            self._listener.bind(str(status_socket))
            undo.callback(status_socket.unlink)
            self._listener.listen(1)
            self._resources = undo.pop_all()

    def __enter__(self) -> Monitor:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._resources.close()

    def poll(self) -> MonitorSample:
        """Process all that was received since the last call. Raises BusError if the hub is gone."""
        now_us = self._now_us()
        while frames := self._bus.receive(0):
            for stamp_us, frame in frames:
                if frame.can_id in self._finger_of:
                    self._note_contact(self._finger_of[frame.can_id], stamp_us, frame)
                elif frame.data == bytes([NmtState.INITIALISING]):
                    self.not_booted.pop(frame.can_id - HEARTBEAT_ID, None)
        if self._statistics_us is None or now_us - self._statistics_us >= STATISTICS_PERIOD_US:
            self._statistics_us = now_us
            reply = ask(self._hub, AskStatistics())
            self._load = reply.load if isinstance(reply, Statistics) else None
        self._read_status()
        return MonitorSample(
            status=self._status,
            latency_us=tuple(_recent_median_us(latencies, now_us) for latencies in self._latencies),
            load=self._load,
        )

    def _note_contact(self, finger: int, stamp_us: int, frame: CanFrame) -> None:
        contact = self._fingertips[finger].receive(stamp_us, frame)
        if contact is not None:
            self._latencies[finger].append((stamp_us, contact.received_at_us - contact.exposed_at_us))

    def _read_status(self) -> None:
        """Take the whole lines of the status stream; keep the newest status."""
        if self._stream is None:
            with contextlib.suppress(BlockingIOError):
                self._stream, _ = self._listener.accept()
                self._resources.callback(self._stream.close)
                self._stream.setblocking(False)
        while self._stream is not None:
            try:
                data = self._stream.recv(CHUNK_BYTES)
            except BlockingIOError:
                return
            if not data:  # the host exited: the process monitor reports that
                return
            *lines, self._partial_line = (self._partial_line + data).split(b"\n")
            for line in lines:
                self._status = self._decoder.decode(line)
                self._on_status(self._status)


def _recent_median_us(latencies: deque[tuple[int, int]], now_us: int) -> float | None:
    while latencies and now_us - latencies[0][0] > LATENCY_WINDOW_US:
        latencies.popleft()
    return median(latency_us for _, latency_us in latencies) if latencies else None
