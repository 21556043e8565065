"""A port on the local CAN hub: the link of `Bus` to it, and what the python-can plug-in stands on.

Differences from SocketCAN: the port itself refuses a frame when its transmit queue is full. While it is
bus-off, sending raises BusOffError; an error report arrives at the beginning (CAN_ERR_BUSOFF) and at the end
(CAN_ERR_RESTARTED).
"""

from __future__ import annotations

import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from palpate_bus.hub import connection as link
from palpate_bus.hub import protocol
from palpate_bus.hub.default_socket import default_socket
from palpate_bus.hub.protocol import FrameFlag, Hello, Kind, PortMode
from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame, check_frame
from palpate_edge.can_bus.link import (
    CAN_ERR_BUSOFF,
    CAN_ERR_CRTL,
    CAN_ERR_RESTARTED,
    CRTL_RECEIVE_OVERFLOW,
    Arrival,
    ErrorReport,
    LinkSettings,
    Marks,
)
from palpate_edge.common.errors import BusError, BusOffError

MAX_PENDING = 8192  # arrivals that `receive` has not taken yet
MAX_BURST = 512  # frames queued at once
WAIT_SLICE_S = 0.005
# Plain integers, because IntFlag arithmetic would be the most expensive step for each frame.
_ASK_VERDICT, _BUS_OFF = int(PortMode.ASK_VERDICT), int(PortMode.BUS_OFF)
_VERDICT_WANTED, _OWN = int(FrameFlag.VERDICT_WANTED), int(FrameFlag.OWN)


class HubPort:
    """See `Link`. Thread-safe: one thread may receive while others send.

    settings.channel: path of the hub's socket; empty for the default one. settings.name: the port's name for
    faults and statistics. settings.bitrate: 0 for the hub's; a different one is rejected, as is a different
    data_bitrate. Raises BusError when there is no hub or the hub rejects the connection.
    """

    marks = Marks.PROGRAM
    patience_s = 0.5  # a busy PC may leave the hub without a processor for longer than a bus is busy

    def __init__(self, settings: LinkSettings) -> None:
        self.path = Path(settings.channel) if settings.channel else default_socket()
        self.is_off = False
        self.name = settings.name
        self._carries_fd = settings.data_bitrate is not None
        self._splitter = protocol.Splitter()
        self._arrivals: deque[Arrival] = deque()
        self._asks_verdict = False
        self._credits = 0
        self._verdicts: deque[bool] = deque()
        self._gone: BusError | None = None
        self._receive_lock = threading.Lock()
        self._send_lock = threading.Lock()
        self._socket = link.connect(self.path)
        # Frames that are decoded but not taken yet must keep `fileno` readable: the eventfd is set for them.
        self._pending = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._pending_shown = False
        self._epoll = select.epoll()
        self._epoll.register(self._socket, select.EPOLLIN)
        self._epoll.register(self._pending, select.EPOLLIN)
        self._welcomed = self._closed = False
        try:
            self._greet(settings)
        except BusError:
            self.close()
            raise

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """See `Link.try_send`."""
        sent = 0
        with self._send_lock:
            try:
                while sent < len(frames) and (count := self._send_some(frames[sent:])):
                    sent += count
            except BusError:
                if not sent:
                    raise
        return sent

    def wait_for_room(self, timeout_s: float) -> None:
        """Wait until the transmit queue has room or the port is bus-off, up to `timeout_s`."""
        with self._send_lock:
            self._wait_until(lambda: self._credits > 0 or self.is_off, timeout_s)

    def receive(self, timeout_s: float) -> Iterator[Arrival]:
        """See `Link.receive`."""
        arrival = self.next_arrival(timeout_s)
        while arrival is not None:
            yield arrival
            arrival = self.next_arrival(0)

    def next_arrival(self, timeout_s: float | None) -> Arrival | None:
        """Return the next arrival, None after the timeout; None waits without limit. Raises BusError."""
        found = self._take_arrival()
        if found is not None or timeout_s == 0:
            return found
        end_s = None if timeout_s is None else time.monotonic() + timeout_s
        left_s = timeout_s
        while found is None and (left_s is None or left_s > 0):
            select.select([self._epoll], [], [], left_s)  # epoll's own timeout is rounded up to 1 ms
            found = self._take_arrival()  # None: the hub sent something else, such as credits
            left_s = None if end_s is None else end_s - time.monotonic()
        return found

    def accept(self, can_ids: Sequence[int]) -> None:
        """See `Link.accept`."""
        self.set_filters([(can_id, MAX_STANDARD_ID) for can_id in can_ids])

    def set_filters(self, pairs: list[tuple[int, int]] | None) -> None:
        """Set the pairs of identifier and mask; None receives everything. Raises BusError."""
        with self._send_lock:
            link.send(self._socket, self.path, protocol.filters_message(pairs))

    def fileno(self) -> int:
        """See `Link.fileno`."""
        return self._epoll.fileno()

    def close(self) -> None:
        """See `Link.close`."""
        if not self._closed:
            self._closed = True
            self._epoll.close()
            self._socket.close()
            os.close(self._pending)

    def _greet(self, settings: LinkSettings) -> None:
        hello = Hello(
            self.name, settings.bitrate, settings.echo, control_only=False, data_bitrate=settings.data_bitrate
        )
        link.send(self._socket, self.path, protocol.hello_message(hello))
        deadline_s = time.monotonic() + link.ANSWER_TIMEOUT_S
        while not self._welcomed:
            if not link.wait_readable(self._socket.fileno(), deadline_s - time.monotonic()):
                raise link.silent(self.path)
            self._take_arrived()
        accept_ids = settings.accept_ids
        self.set_filters(None if accept_ids is None else [(can_id, MAX_STANDARD_ID) for can_id in accept_ids])

    def _send_some(self, frames: Sequence[CanFrame]) -> int:
        """Queue leading frames; return how many, 0 when the transmit queue is full."""
        self._take_arrived()
        if self.is_off:
            raise BusOffError(f"{self.name} is bus-off at palpate hub {self.path}")
        wants_verdict = self._asks_verdict
        some = self._valid(frames[: min(self._credits, 1 if wants_verdict else MAX_BURST)])
        if not some:
            return 0
        link.send(
            self._socket, self.path, protocol.send_messages(some, _VERDICT_WANTED if wants_verdict else 0)
        )
        with self._receive_lock:
            self._credits -= len(some)
        if wants_verdict and not self._verdict():
            with self._receive_lock:
                self._credits += 1
            return 0
        return len(some)

    def _valid(self, frames: Sequence[CanFrame]) -> Sequence[CanFrame]:
        """Return the frames before the first one that the bus cannot carry; raise BusError if it is the
        first."""
        for count, frame in enumerate(frames):
            try:
                check_frame(frame, fd=self._carries_fd)
            except BusError:
                if count:
                    return frames[:count]
                raise
        return frames

    def _take_arrival(self) -> Arrival | None:
        if not self._arrivals:
            self._take_arrived()
        with self._receive_lock:
            found = self._arrivals.popleft() if self._arrivals else None
            self._show_pending()
        return found

    def _take_arrived(self) -> None:
        """Process what the hub has sent, without waiting."""
        with self._receive_lock:
            try:
                if self._gone is None and self._epoll.poll(0):  # costs a fifth of a receive without data
                    for kind, payload in self._splitter.feed(link.receive(self._socket, self.path)):
                        self._handle(kind, payload)
                    self._show_pending()
            except BusError as error:
                self._gone = error
            if self._gone is not None and not self._arrivals:
                raise self._gone

    def _handle(self, kind: Kind, payload: bytes) -> None:
        if kind in (Kind.DELIVER, Kind.DELIVER_FD):
            for won_at_us, flags, frame in protocol.parse_stamped(kind, payload):
                self._keep((won_at_us, frame, bool(flags & _OWN)))
        elif kind is Kind.CREDIT:
            self._credits += protocol.parse_count(payload)
        elif kind is Kind.VERDICT:
            self._verdicts.append(bool(protocol.parse_byte(payload)))
        elif kind is Kind.MODE:
            self._change_mode(protocol.parse_byte(payload))
        elif kind is Kind.OVERRUN:
            self._arrivals.append(_report(CAN_ERR_CRTL, CRTL_RECEIVE_OVERFLOW))
        elif kind is Kind.WELCOME:
            self._credits, _ = protocol.parse_welcome(payload)
            self._welcomed = True
        elif kind is Kind.REJECT:
            raise link.rejected(self.path, payload)
        else:
            raise protocol.GarbledStreamError(f"unexpected message {kind.name} from the hub")

    def _keep(self, arrival: Arrival) -> None:
        """Store an arrival; at most MAX_PENDING, since a client may send without ever receiving."""
        if len(self._arrivals) < MAX_PENDING:
            self._arrivals.append(arrival)
        elif not isinstance(self._arrivals[-1][1], ErrorReport):
            self._arrivals.append(_report(CAN_ERR_CRTL, CRTL_RECEIVE_OVERFLOW))

    def _change_mode(self, mode: int) -> None:
        off = bool(mode & _BUS_OFF)
        if off != self.is_off:
            self._arrivals.append(_report(CAN_ERR_BUSOFF if off else CAN_ERR_RESTARTED))
        self.is_off, self._asks_verdict = off, bool(mode & _ASK_VERDICT)

    def _show_pending(self) -> None:
        pending = bool(self._arrivals)
        if pending != self._pending_shown:
            if pending:
                os.eventfd_write(self._pending, 1)
            else:
                os.eventfd_read(self._pending)
            self._pending_shown = pending

    def _verdict(self) -> bool:
        if not self._wait_until(lambda: bool(self._verdicts), link.ANSWER_TIMEOUT_S):
            raise link.silent(self.path)
        return self._verdicts.popleft()

    def _wait_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Process messages until the condition holds; return False after the timeout."""
        deadline_s = time.monotonic() + timeout_s
        while True:
            self._take_arrived()
            left_s = deadline_s - time.monotonic()
            if condition() or left_s <= 0:
                return condition()
            # Wait in slices: another receiving thread may have read the awaited message from the socket.
            link.wait_readable(self._socket.fileno(), min(left_s, WAIT_SLICE_S))


def _report(error_class: int, controller: int = 0) -> Arrival:
    return time.time_ns() // 1000, ErrorReport(error_class, controller), False
