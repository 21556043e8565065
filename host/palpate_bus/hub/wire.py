"""The bus itself, pure: ports with bounded transmit queues, arbitration, bit times, acceptance filters.

Time is an argument (epoch or virtual microseconds) and never goes back. When the wire is free the heads of
all transmit queues compete and the lowest identifier wins; a data frame wins over a remote frame of the same
identifier (its RTR bit is dominant). Source: Bosch CAN Specification 2.0, part A, 3 "arbitration".
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum

from palpate_bus.load.bit_count import frame_bits
from palpate_edge.can_bus.can_frame import CanFrame

Filters = Sequence[tuple[int, int]] | None  # (identifier, mask); None accepts everything


class Submitted(Enum):
    """What became of a submitted frame."""

    QUEUED = "queued"
    QUEUE_FULL = "queue full"
    BUS_OFF = "bus off"


@dataclass(frozen=True, slots=True)
class Delivery:
    """One frame that went over the wire.

    won_at_us: when it won the wire (start of frame). sender: its port; receivers: ports whose filters match.
    bits: its length on the wire, interframe space included. copy: as in `Wire.submit`.
    """

    won_at_us: int
    sender: int
    receivers: tuple[int, ...]
    frame: CanFrame
    bits: int
    copy: bool


@dataclass(frozen=True, slots=True)
class _Waiting:
    since_us: int
    frame: CanFrame
    copy: bool


@dataclass(slots=True)
class _Port:
    receive_own: bool
    filters: Filters = ()
    queue: deque[_Waiting] = field(default_factory=deque)
    counted: int = 0  # in the queue, copies left out
    bus_off: bool = False
    leaving: bool = False

    def accepts(self, can_id: int) -> bool:
        if self.bus_off:
            return False
        return self.filters is None or any((can_id ^ wanted) & mask == 0 for wanted, mask in self.filters)


class Wire:
    """The wire and its ports.

    bitrate: bit/s; 0 means that a frame takes no time. txqueuelen: frames a port may have waiting.
    """

    def __init__(self, bitrate: int, txqueuelen: int) -> None:
        self.bitrate = bitrate
        self.txqueuelen = txqueuelen
        self._ports: dict[int, _Port] = {}
        self._next_port = 0
        self._free_at_us = 0
        self._on_wire: Delivery | None = None
        self._routes: dict[tuple[int, int], tuple[int, ...]] = {}

    def attach(self, receive_own: bool) -> int:
        """A new port; it hears nothing before `set_filters`. Returns its number, never used again."""
        port = self._next_port
        self._next_port += 1
        self._ports[port] = _Port(receive_own)
        self._routes.clear()
        return port

    def detach(self, port: int) -> None:
        """Removes a port as soon as its queue is empty; it hears nothing from now on.

        What a node has queued before it leaves still goes out, as it does from a controller's queue: its last
        words may be the command to stop.
        """
        leaver = self._ports[port]
        leaver.leaving = True
        leaver.filters = ()
        self._routes.clear()
        if not leaver.queue:
            del self._ports[port]

    def set_filters(self, port: int, filters: Filters) -> None:
        """Acceptance filters of a port: a frame passes when one of them equals it under its mask."""
        self._ports[port].filters = filters
        self._routes.clear()

    def set_bus_off(self, port: int, off: bool) -> int:
        """Cuts a port off or lets it back; returns how many waiting frames (copies left out) were lost."""
        cut = self._ports[port]
        cut.bus_off = off
        self._routes.clear()
        lost = cut.counted
        cut.queue.clear()
        cut.counted = 0
        return lost

    def submit(self, port: int, frame: CanFrame, now_us: int, copy: bool = False) -> Submitted:
        """Puts a frame at the end of the port's transmit queue.

        copy: a fault's second copy of a frame, which takes no place of the sender's queue.
        """
        sender = self._ports[port]
        if sender.bus_off:
            return Submitted.BUS_OFF
        if not copy:
            if sender.counted >= self.txqueuelen:
                return Submitted.QUEUE_FULL
            sender.counted += 1
        sender.queue.append(_Waiting(now_us, frame, copy))
        return Submitted.QUEUED

    def advance(self, now_us: int) -> list[Delivery]:
        """Runs the wire up to `now_us`; returns the frames whose last bit is over, in wire order."""
        done: list[Delivery] = []
        while True:
            if self._on_wire is not None:
                if self._free_at_us > now_us:
                    return done
                done.append(self._on_wire)
                self._on_wire = None
            if not self._start_next(now_us):
                return done

    @property
    def next_due_us(self) -> int | None:
        """When `advance` has something to do next; None while nothing is on the wire or waiting."""
        if self._on_wire is not None:
            return self._free_at_us
        return self._next_start_us()

    def _next_start_us(self) -> int | None:
        heads = [port.queue[0].since_us for port in self._ports.values() if port.queue]
        return max(self._free_at_us, min(heads)) if heads else None

    def _start_next(self, now_us: int) -> bool:
        start_us = self._next_start_us()
        if start_us is None or start_us > now_us:
            return False
        winner = min(
            (
                port
                for port, state in self._ports.items()
                if state.queue and state.queue[0].since_us <= start_us
            ),
            key=self._priority,
        )
        sender = self._ports[winner]
        waiting = sender.queue.popleft()
        sender.counted -= not waiting.copy
        if sender.leaving and not sender.queue:
            self.detach(winner)
        frame = waiting.frame
        bits = frame_bits(frame)
        receivers = self._receivers(winner, frame.can_id)
        self._on_wire = Delivery(start_us, winner, receivers, frame, bits, waiting.copy)
        duration_us = -(-bits * 1_000_000 // self.bitrate) if self.bitrate else 0
        self._free_at_us = start_us + duration_us
        return True

    def _priority(self, port: int) -> tuple[int, bool, int]:
        frame = self._ports[port].queue[0].frame
        return frame.can_id, frame.remote, port

    def _receivers(self, sender: int, can_id: int) -> tuple[int, ...]:
        route = self._routes.get((sender, can_id))
        if route is None:
            route = tuple(
                number
                for number, port in self._ports.items()
                if (number != sender or port.receive_own) and port.accepts(can_id)
            )
            self._routes[sender, can_id] = route
        return route
