"""The I/O boundary of every bus core: CanFrame values in and out of any python-can interface.

`BusConfig.interface` chooses the bus: ``socketcan`` on a board (channel ``can0``), ``palpate`` for the local
hub (channel = socket path), or any other python-can interface. No other file of palpate_edge imports
python-can.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from types import TracebackType
from typing import Annotated, Any

import can
import msgspec

from palpate_edge.can_bus.back_off import BackOff
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame
from palpate_edge.common.errors import BusError, BusOffError

# linux/can/error.h: class bits of an error frame's identifier.
CAN_ERR_CRTL = 0x004
CAN_ERR_BUSOFF = 0x040
CAN_ERR_RESTARTED = 0x100
# data[1] of a CAN_ERR_CRTL frame.
CRTL_RECEIVE_OVERFLOW = 0x01
CRTL_PASSIVE = 0x30
CRTL_ACTIVE = 0x40

# A full transmit queue is retried after 0.2, 0.4, ... 25.6 ms, 51 ms in all: longer than a full 128-frame
# queue needs to drain at 1 Mbit/s (17 ms), short against a heartbeat time.
SEND_TRIES = 9
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.0002, 0.0256

SOCKET_BUFFER_FULL = "Transmit buffer full"  # the text of python-can's socketcan, which sets no error code


RECEIVE_BATCH = 512  # most frames a call of `receive` returns, so that a flooded bus cannot block its caller


class Marks(Enum):
    """Meaning of an interface's mark on a received frame (`can.Message.is_rx` is False).

    PROGRAM: this program sent it; MACHINE: some program of this machine did (MSG_DONTROUTE).
    """

    NONE = "none"
    PROGRAM = "program"
    MACHINE = "machine"


MARKS = {"palpate": Marks.PROGRAM, "socketcan": Marks.MACHINE}


class BusConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The section [bus] of a configuration file.

    interface: a python-can interface name (``socketcan``, ``palpate``, ``virtual``, ``slcan`` ...).
    channel: the interface's channel; empty for the default (``can0`` for socketcan, the hub's default
    socket).
    bitrate: bit/s. SocketCAN takes its rate from the link's configuration; the hub refuses a rate that is not
        its own.
    clock: the file of a simulated hand's clock (simulated_clock.py); empty for the machine's own clock, as on
        every real bus.
    """

    interface: Annotated[str, msgspec.Meta(min_length=1)] = "socketcan"
    channel: str = ""
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 1_000_000
    clock: str = ""


class Bus:
    """An open bus; `open_bus` makes it.

    Every failure is a `BusError`. Bus-off raises BusOffError from `receive` (a BusError from `send` where the
    driver reports it there); the bus may be used again once `counters.restarts` has grown. error_passive: the
    controller's last report. 29-bit and CAN FD frames are counted in `counters.foreign_frames` and left out,
    this program's own frames in `counters.own_echoes`; expects_echo: the caller's test for the latter, where
    the interface does not mark them.
    """

    def __init__(self, bus: can.BusABC, config: BusConfig, name: str, *, echo: bool = False) -> None:
        self._bus = bus
        self.expects_echo: Callable[[CanFrame], bool] = lambda _: False
        self._marks = MARKS.get(config.interface, Marks.NONE)
        self._drops_echoes = not echo
        # Only the hub's client has this method: other interfaces take one frame a call.
        self._send_burst: Callable[[Sequence[CanFrame]], int] = getattr(bus, "send_burst", lambda _: 0)
        self._where = f"{config.interface} bus {config.channel or '(default channel)'} of {name}"
        self._failure: BusError | None = None
        self.error_passive = False
        self.counters = BusCounters()

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Queue the frames for transmission, in order.

        Raises BusError when the transmit queue stays full (ENOBUFS) for all retries, when the bus is off, or
        when it is down; the frames before the refused one are sent.
        """
        frames = tuple(frames)
        count = self._send_together(frames) if len(frames) > 1 else 0
        for frame in frames[count:]:
            self._send_one(frame)

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """Queue frames without waiting; return how many: fewer than given when the transmit queue is full.

        Raises BusError when the bus is off or down; if frames were queued before, only the next call raises.
        """
        count = self._send_together(frames) if len(frames) > 1 else 0
        try:
            while count < len(frames) and self._try_one(frames[count]):
                count += 1
        except BusError:
            if count == 0:
                raise
        return count

    def receive(self, timeout_s: float) -> list[tuple[int, CanFrame]]:
        """Wait up to `timeout_s` for a first frame, then take all pending frames (at most 512).

        Returns (epoch time in us, frame) in the order of the bus; empty after the timeout. Raises BusError on
        bus-off and when the bus is down, but only after the frames received before were returned.
        """
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        frames: list[tuple[int, CanFrame]] = []
        try:
            message = self._receive_one(timeout_s)
            while message is not None:
                self._sort_in(message, frames)
                if len(frames) == RECEIVE_BATCH:
                    break
                message = self._receive_one(0)
        except BusError as error:
            if not frames:
                raise
            self._failure = error
        self.counters.received += len(frames)
        return frames

    def accept(self, can_ids: Sequence[int]) -> None:
        """Receive only these 11-bit identifiers from now on. Raises BusError."""
        try:
            self._bus.set_filters(_filters(can_ids))
        except (can.CanError, OSError) as error:
            raise BusError(f"{self._where}: cannot set filters: {_one_line(error)}") from error

    def fileno(self) -> int:
        """Return a descriptor that polls readable when `receive` has frames.

        Raises BusError on an interface without one (``virtual``).
        """
        try:
            return self._bus.fileno()
        except NotImplementedError as error:
            raise BusError(
                f"{self._where} has no file descriptor to poll: use socketcan or palpate"
            ) from error

    def close(self) -> None:
        """Close the bus; a second call does nothing."""
        self._bus.shutdown()

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send_together(self, frames: Sequence[CanFrame]) -> int:
        try:
            count = self._send_burst(frames)
        except can.CanError as error:
            raise self._cannot_send(error) from error
        self.counters.sent += count
        return count

    def _try_one(self, frame: CanFrame) -> bool:
        message = can.Message(
            arbitration_id=frame.can_id, is_extended_id=False, is_remote_frame=frame.remote, data=frame.data
        )
        try:
            self._bus.send(message)
        except can.CanError as error:
            if error.error_code == errno.ENOBUFS or SOCKET_BUFFER_FULL in str(error):
                return False
            raise self._cannot_send(error) from error
        self.counters.sent += 1
        return True

    def _cannot_send(self, error: can.CanError) -> BusError:
        return BusError(f"{self._where}: cannot send: {_one_line(error)}")

    def _send_one(self, frame: CanFrame) -> None:
        back_off = BackOff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        for attempt in range(SEND_TRIES):
            if self._try_one(frame):
                return
            if attempt < SEND_TRIES - 1:
                self.counters.send_retries += 1
                time.sleep(back_off.pause())
        raise BusError(
            f"{self._where}: transmit queue full, frame {frame.can_id:03X} refused "
            f"{SEND_TRIES} times: check the cabling and the bus load (palpate-host bus stats, or ip -s link)"
        )

    def _receive_one(self, timeout_s: float) -> can.Message | None:
        try:
            return self._bus.recv(timeout_s)
        except can.CanError as error:
            raise BusError(f"{self._where}: cannot receive: {_one_line(error)}") from error

    def _sort_in(self, message: can.Message, frames: list[tuple[int, CanFrame]]) -> None:
        if message.is_error_frame:
            self._note_error_frame(message)
        elif message.is_extended_id or message.is_fd:
            self.counters.foreign_frames += 1
        else:
            frame = CanFrame(message.arbitration_id, bytes(message.data), message.is_remote_frame)
            if self._is_echo(message, frame):
                self.counters.own_echoes += 1
            else:
                frames.append((round(message.timestamp * 1e6), frame))

    def _is_echo(self, message: can.Message, frame: CanFrame) -> bool:
        """Return whether this program sent the frame, through this socket or an earlier one."""
        if not self._drops_echoes or (message.is_rx and self._marks is not Marks.NONE):
            return False
        return self._marks is Marks.PROGRAM or self.expects_echo(frame)

    def _note_error_frame(self, message: can.Message) -> None:
        self.counters.error_frames += 1
        if message.arbitration_id & CAN_ERR_RESTARTED:
            self.counters.restarts += 1
            self.error_passive = False
        if message.arbitration_id & CAN_ERR_BUSOFF:
            raise BusOffError(
                f"{self._where}: the controller went bus-off: check wiring, termination and bit rate; it "
                "recovers by itself if the link restarts (ip link set can0 type can restart-ms 100)"
            )
        if message.arbitration_id & CAN_ERR_CRTL and len(message.data) > 1:
            status = message.data[1]
            self.counters.receive_overruns += bool(status & CRTL_RECEIVE_OVERFLOW)
            if status & (CRTL_PASSIVE | CRTL_ACTIVE):
                self.error_passive = bool(status & CRTL_PASSIVE)


def open_bus(
    config: BusConfig, name: str, accept_ids: Sequence[int] | None = None, *, echo: bool = False
) -> Bus:
    """Open the bus of `config`.

    name: of the program, for messages and the hub's statistics (``finger-1``).
    accept_ids: the 11-bit identifiers to receive, filtered by kernel, controller or hub; None for all.
    echo: receive also this program's own frames among them, stamped when they were on the wire.
    Raises BusError with the reason and the remedy.
    """
    if config.interface not in can.VALID_INTERFACES:
        raise BusError(
            f"bus of {name}: python-can has no interface {config.interface!r} "
            f"(channel {config.channel!r}): set socketcan or palpate"
        )
    if accept_ids is not None and not accept_ids:
        raise BusError(f"bus of {name}: accept_ids is empty: give an identifier, or None to receive all")
    options: dict[str, Any] = {"bitrate": config.bitrate, "receive_own_messages": echo}
    if config.interface == "palpate":
        options["name"] = name
    channel = config.channel or ("can0" if config.interface == "socketcan" else None)
    try:
        bus = can.Bus(
            channel=channel,
            interface=config.interface,
            can_filters=None if accept_ids is None else _filters(accept_ids),
            ignore_config=True,
            **options,
        )
    except (can.CanError, OSError, ValueError) as error:
        raise open_error(config, name, error) from error
    return Bus(bus, config, name, echo=echo)


def open_error(config: BusConfig, name: str, error: Exception) -> BusError:
    """Return the error for a bus that python-can cannot open, with the remedy where it is known."""
    reason = _one_line(error)
    if config.interface == "palpate":
        return BusError(reason)  # the hub's plug-in states the remedy itself
    if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
        return BusError(
            'this kernel has no SocketCAN: load can_raw, or set interface = "palpate" (local hub)'
        )
    return BusError(f"{config.interface} bus {config.channel or 'can0'} of {name} cannot be opened: {reason}")


def _filters(can_ids: Sequence[int]) -> list[can.typechecking.CanFilter]:
    return [{"can_id": can_id, "can_mask": MAX_STANDARD_ID, "extended": False} for can_id in can_ids]


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
