"""The hub as a python-can interface.

``can.Bus(interface="palpate", channel="/run/hub.sock", name="finger-1")``

Differences from SocketCAN: the client itself refuses a frame when its transmit queue is full (error_code
ENOBUFS, after `timeout` if given). While a port is bus-off, `send` raises ENETDOWN and `state` is ERROR;
`can.BusABC.recv` returns an error frame at the beginning (class CAN_ERR_BUSOFF) and at the end
(CAN_ERR_RESTARTED).
"""

from __future__ import annotations

import errno
import itertools
import os
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path

import can
from can.typechecking import CanFilters

from palpate_bus.hub import connection as link
from palpate_bus.hub import protocol
from palpate_bus.hub.can_message import classic_frame, error_frame, is_data_frame, message
from palpate_bus.hub.default_socket import default_socket
from palpate_bus.hub.protocol import FrameFlag, Hello, Kind, PortMode
from palpate_edge.can_bus.bus import CAN_ERR_BUSOFF, CAN_ERR_CRTL, CAN_ERR_RESTARTED
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError

CRTL_RX_OVERFLOW = 0x01  # linux/can/error.h: data[1] of a CAN_ERR_CRTL frame
MAX_PENDING = 8192  # frames that `can.BusABC.recv` has not taken yet
MAX_BURST = 512  # frames in one message
WAIT_SLICE_S = 0.005
# Plain integers, because IntFlag arithmetic would be the most expensive step for each frame.
_ASK_VERDICT, _BUS_OFF = int(PortMode.ASK_VERDICT), int(PortMode.BUS_OFF)
_VERDICT_WANTED = int(FrameFlag.VERDICT_WANTED)


class HubBus(can.BusABC):
    """A port on the local CAN hub. Classic CAN with 11-bit identifiers, which is all that CANopen uses.

    channel: path of the hub's socket; None for the default one. name: the port's name for faults and
    statistics. bitrate: 0 or None for the hub's; a different one is rejected. Thread-safe: one thread may
    receive while others send. Raises can.CanInitializationError when there is no hub or the hub rejects the
    connection.
    """

    def __init__(
        self,
        channel: str | os.PathLike[str] | None = None,
        can_filters: CanFilters | None = None,
        *,
        name: str = "",
        bitrate: int | None = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        **kwargs: object,  # noqa: ARG002 (python-can hands every option of its configuration to every bus)
    ) -> None:
        if fd:
            raise can.CanInitializationError("the CAN hub supports classic CAN only: omit fd")
        try:
            self._path = Path(channel) if channel else default_socket()
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        self.channel_info = f"palpate hub {self._path}"
        self._name = name or f"process-{os.getpid()}"
        self._splitter = protocol.Splitter()
        self._messages: deque[can.Message] = deque()
        self._state = can.BusState.ACTIVE
        self._is_off = self._asks_verdict = False
        self._credits = 0
        self._verdicts: deque[bool] = deque()
        self._gone: str | None = None
        self._receive_lock = threading.Lock()
        self._send_lock = threading.Lock()
        try:
            self._socket = link.connect(self._path)
        except BusError as error:
            raise can.CanInitializationError(str(error)) from error
        # Messages that are decoded but not taken yet must keep `fileno` readable: the eventfd is set for
        # them.
        self._pending = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._pending_shown = False
        self._epoll = select.epoll()
        self._epoll.register(self._socket, select.EPOLLIN)
        self._epoll.register(self._pending, select.EPOLLIN)
        self._welcomed = False
        hello = Hello(self._name, bitrate or 0, receive_own_messages, control_only=False)
        try:
            self._greet(hello)
            super().__init__(channel=str(self._path), can_filters=can_filters)
        except can.CanError as error:
            self._close()
            raise can.CanInitializationError(str(error)) from error

    @property
    def state(self) -> can.BusState:
        """ACTIVE, or ERROR while the port is bus-off."""
        return self._state

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise can.CanOperationError(
            f"the state of a hub port cannot be set to {new_state.name}: only the hub changes it"
        )

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Queue one frame; with a timeout (s) wait up to that long for space in the transmit queue.

        Raises can.CanOperationError: ENOBUFS queue full, ENETDOWN bus-off, EINVAL not a classic 11-bit frame
        (29-bit, FD, error frame, more than 8 bytes), EPIPE hub stopped.
        """
        frame = classic_frame(msg)
        with self._send_lock:
            self._take_arrived()
            if self._credits == 0 and timeout:
                self._wait_until(lambda: self._credits > 0 or self._is_off, timeout)
            if self._is_off:
                raise can.CanOperationError(f"{self._name} is bus-off at {self.channel_info}", errno.ENETDOWN)
            if self._credits == 0:
                raise self._queue_full(frame)
            wants_verdict = self._asks_verdict
            self._transmit([frame], _VERDICT_WANTED if wants_verdict else 0)
            if wants_verdict and not self._verdict():
                with self._receive_lock:
                    self._credits += 1
                raise self._queue_full(frame)

    def send_burst(self, frames: Sequence[CanFrame]) -> int:
        """Queue the leading frames in one message and return how many were queued.

        Stops when the transmit queue is full, and before a remote frame or one that is not a classic 11-bit
        frame. Queues none at bus-off and while a fault requires a verdict on each frame. `send` handles all
        these cases. Raises can.CanOperationError: EPIPE hub stopped.
        """
        with self._send_lock:
            self._take_arrived()
            if self._is_off or self._asks_verdict:
                return 0
            burst = frames[: min(self._credits, MAX_BURST)]
            if not all(map(is_data_frame, burst)):
                burst = list(itertools.takewhile(is_data_frame, burst))
            if burst:
                self._transmit(burst, 0)
            return len(burst)

    def fileno(self) -> int:
        """Return a descriptor that polls readable when `can.BusABC.recv` has a message or an error."""
        return self._epoll.fileno()

    def shutdown(self) -> None:
        """Close the connection; a second call has no effect."""
        if self._is_shutdown:
            return
        super().shutdown()
        self._close()

    def _close(self) -> None:
        self._epoll.close()
        self._socket.close()
        os.close(self._pending)

    def _greet(self, hello: Hello) -> None:
        self._write(protocol.hello_message(hello))
        deadline_s = time.monotonic() + link.ANSWER_TIMEOUT_S
        while not self._welcomed:
            if not link.wait_readable(self._socket.fileno(), deadline_s - time.monotonic()):
                raise can.CanOperationError(
                    f"{self.channel_info} does not reply within {link.ANSWER_TIMEOUT_S:.0f} s: restart it"
                )
            self._take_arrived()

    def _apply_filters(self, filters: CanFilters | None) -> None:
        pairs: list[tuple[int, int]] | None = None
        if filters:  # python-can: an empty sequence accepts everything
            pairs = [
                (entry["can_id"] & 0xFFFFFFFF, entry["can_mask"] & 0xFFFFFFFF)
                for entry in filters
                if not entry.get("extended", False)
            ]
        with self._send_lock:
            self._write(protocol.filters_message(pairs))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        found = self._next_message()
        if found is None and (timeout is None or timeout > 0):
            self._epoll.poll(timeout)
            found = self._next_message()
        return found, True

    def _next_message(self) -> can.Message | None:
        if not self._messages:
            self._take_arrived()
        with self._receive_lock:
            found = self._messages.popleft() if self._messages else None
            self._show_pending()
        return found

    def _take_arrived(self) -> None:
        """Process what the hub has sent, without waiting."""
        with self._receive_lock:
            try:
                if self._gone is None and self._epoll.poll(
                    0
                ):  # a poll costs a fifth of a `can.BusABC.recv` without data
                    for kind, payload in self._splitter.feed(link.receive(self._socket, self._path)):
                        self._handle(kind, payload)
                    self._show_pending()
            except BusError as error:
                self._gone = str(error)
            if self._gone is not None and not self._messages:
                raise can.CanOperationError(self._gone, errno.EPIPE)

    def _handle(self, kind: Kind, payload: bytes) -> None:
        if kind is Kind.DELIVER:
            for won_at_us, flags, frame in protocol.parse_stamped(payload):
                self._keep(message(won_at_us, flags, frame, str(self._path)))
        elif kind is Kind.CREDIT:
            self._credits += protocol.parse_count(payload)
        elif kind is Kind.VERDICT:
            self._verdicts.append(bool(protocol.parse_byte(payload)))
        elif kind is Kind.MODE:
            self._change_mode(protocol.parse_byte(payload))
        elif kind is Kind.OVERRUN:
            self._messages.append(error_frame(CAN_ERR_CRTL, CRTL_RX_OVERFLOW))
        elif kind is Kind.WELCOME:
            self._credits, _ = protocol.parse_welcome(payload)
            self._welcomed = True
        elif kind is Kind.REJECT:
            raise link.rejected(self._path, payload)
        else:
            raise protocol.GarbledStreamError(f"unexpected message {kind.name} from the hub")

    def _keep(self, arrived: can.Message) -> None:
        """Store a message; at most MAX_PENDING, since a client may send without ever receiving."""
        if len(self._messages) < MAX_PENDING:
            self._messages.append(arrived)
        elif not self._messages[-1].is_error_frame:
            self._messages.append(error_frame(CAN_ERR_CRTL, CRTL_RX_OVERFLOW))

    def _change_mode(self, mode: int) -> None:
        off = bool(mode & _BUS_OFF)
        if off != self._is_off:
            self._state = can.BusState.ERROR if off else can.BusState.ACTIVE
            self._messages.append(error_frame(CAN_ERR_BUSOFF if off else CAN_ERR_RESTARTED))
        self._is_off, self._asks_verdict = off, bool(mode & _ASK_VERDICT)

    def _show_pending(self) -> None:
        pending = bool(self._messages)
        if pending != self._pending_shown:
            if pending:
                os.eventfd_write(self._pending, 1)
            else:
                os.eventfd_read(self._pending)
            self._pending_shown = pending

    def _transmit(self, frames: Sequence[CanFrame], flags: int) -> None:
        records = b"".join([protocol.pack_frame(frame, flags) for frame in frames])
        self._write(protocol.message(Kind.SEND, records))
        with self._receive_lock:
            self._credits -= len(frames)

    def _verdict(self) -> bool:
        if not self._wait_until(lambda: bool(self._verdicts), link.ANSWER_TIMEOUT_S):
            raise can.CanOperationError(
                f"{self.channel_info} does not reply within {link.ANSWER_TIMEOUT_S:.0f} s: restart it",
                errno.ETIMEDOUT,
            )
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

    def _write(self, data: bytes) -> None:
        try:
            link.send(self._socket, self._path, data)
        except BusError as error:
            raise can.CanOperationError(str(error), errno.EPIPE) from error

    def _queue_full(self, frame: CanFrame) -> can.CanOperationError:
        return can.CanOperationError(
            f"the transmit queue of {self._name} is full, frame 0x{frame.can_id:03X} was not sent: retry",
            errno.ENOBUFS,
        )
