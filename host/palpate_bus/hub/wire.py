"""Model of the CAN wire: ports with bounded transmit queues, arbitration, bit times, acceptance filters.

Pure: time is an argument (epoch or simulated microseconds) that never decreases. When the wire is free, the
first frames of all transmit queues compete and the lowest identifier wins; a data frame wins over a remote
frame of the same identifier (its RTR bit is dominant). Source: Bosch CAN Specification 2.0, part A, 3
"arbitration".
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import ceil

from palpate_bus.load.fd_bit_count import bit_times
from palpate_edge.can_bus.can_frame import CanFrame

Filters = Sequence[tuple[int, int]] | None  # (identifier, mask); None accepts everything

UNLIMITED_COUNTS_AS = (
    1_000_000  # nominal bit/s by which the bits of CAN FD frames count where they take no time
)


class Submitted(Enum):
    """Results of submitting a frame."""

    QUEUED = "queued"
    QUEUE_FULL = "queue full"
    BUS_OFF = "bus off"


@dataclass(frozen=True, slots=True)
class Delivery:
    """One frame that was transmitted on the wire.

    won_at_us: time of arbitration (start of frame). sender: its port. receivers: ports whose filters match.
    bits: length on the wire including the interframe space, in bit times of the nominal rate. copy: as in
    `Wire.submit`. classic_ports: those that would receive this CAN FD frame if they had CAN FD.
    """

    won_at_us: int
    sender: int
    receivers: tuple[int, ...]
    frame: CanFrame
    bits: float
    copy: bool
    classic_ports: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class _Waiting:
    since_us: int
    frame: CanFrame
    copy: bool


@dataclass(slots=True)
class _Port:
    receive_own: bool
    has_fd: bool
    filters: Filters = ()
    queue: deque[_Waiting] = field(default_factory=deque)
    counted: int = 0  # frames in the queue, copies excluded
    bus_off: bool = False
    leaving: bool = False

    def accepts(self, can_id: int) -> bool:
        if self.bus_off:
            return False
        return self.filters is None or any((can_id ^ wanted) & mask == 0 for wanted, mask in self.filters)


class Wire:
    """The wire and its ports.

    bitrate: bit/s; with 0 a frame takes no time. txqueuelen: length of each port's transmit queue.
    data_bitrate: bit/s of the data phase of CAN FD frames, None for a classic bus.
    """

    def __init__(self, bitrate: int, txqueuelen: int, data_bitrate: int | None = None) -> None:
        self.bitrate = bitrate
        self.data_bitrate = data_bitrate
        self.txqueuelen = txqueuelen
        self._ports: dict[int, _Port] = {}
        self._next_port = 0
        self._free_at_us = 0
        self._on_wire: Delivery | None = None
        self._routes: dict[tuple[int, int], tuple[int, ...]] = {}

    def attach(self, receive_own: bool, has_fd: bool = False) -> int:
        """Add a port and return its number, which is never reused.

        It receives nothing before `set_filters`, and CAN FD frames only if it `has_fd`.
        """
        port = self._next_port
        self._next_port += 1
        self._ports[port] = _Port(receive_own, has_fd)
        self._routes.clear()
        return port

    def detach(self, port: int) -> None:
        """Stop delivery to a port and remove it as soon as its queue is empty.

        Frames that a node has queued are still transmitted, as from a controller's queue: the last one may be
        a command to stop.
        """
        leaving = self._ports[port]
        leaving.leaving = True
        leaving.filters = ()
        self._routes.clear()
        if not leaving.queue:
            del self._ports[port]

    def set_filters(self, port: int, filters: Filters) -> None:
        """Set a port's acceptance filters: a frame passes when its masked identifier equals one of them."""
        self._ports[port].filters = filters
        self._routes.clear()

    def set_bus_off(self, port: int, off: bool) -> int:
        """Set or clear bus-off of a port; return the number of queued frames lost, copies excluded."""
        cut = self._ports[port]
        cut.bus_off = off
        self._routes.clear()
        lost = cut.counted
        cut.queue.clear()
        cut.counted = 0
        return lost

    def submit(self, port: int, frame: CanFrame, now_us: int, copy: bool = False) -> Submitted:
        """Append a frame to the port's transmit queue.

        copy: an additional copy made by a fault, which does not count towards the queue's length.
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
        """Run the wire up to `now_us`; return the completed frames in the order of transmission."""
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
        """The time at which `advance` is due next, None while no frame is on the wire or waiting."""
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
        bits = bit_times(frame, self.bitrate or UNLIMITED_COUNTS_AS, self.data_bitrate)
        receivers = self._receivers(winner, frame.can_id)
        classic_ports: tuple[int, ...] = ()
        if frame.fd:
            classic_ports = tuple(port for port in receivers if not self._ports[port].has_fd)
            receivers = tuple(port for port in receivers if self._ports[port].has_fd)
        self._on_wire = Delivery(start_us, winner, receivers, frame, bits, waiting.copy, classic_ports)
        duration_us = ceil(bits * 1_000_000 / self.bitrate) if self.bitrate else 0
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
