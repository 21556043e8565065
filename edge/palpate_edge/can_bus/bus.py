"""The I/O boundary of every bus core: CanFrame values in and out of any CAN interface.

`BusConfig.interface` chooses the link: ``socketcan`` on a board (channel ``can0``), ``palpate`` for the local
hub (channel = socket path), or any python-can interface. Only python_can_link.py imports python-can.
"""

from __future__ import annotations

import errno
import time
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from types import TracebackType
from typing import Annotated

import msgspec

from palpate_edge.can_bus.back_off import BackOff
from palpate_edge.can_bus.bus_counters import BusCounters
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.link import (
    CAN_ERR_BUSOFF,
    CAN_ERR_CRTL,
    CAN_ERR_RESTARTED,
    CRTL_ACTIVE,
    CRTL_PASSIVE,
    CRTL_RECEIVE_OVERFLOW,
    GROUP,
    Arrival,
    ErrorReport,
    Link,
    LinkOpener,
    LinkSettings,
    Marks,
)
from palpate_edge.can_bus.socketcan_link import SocketCanLink
from palpate_edge.common.errors import BusError, BusOffError
from palpate_edge.common.plugins import find_part

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.0002, 0.0256  # a full transmit queue is tried again after 0.2, 0.4, ... ms

RECEIVE_BATCH = 512  # most frames a call of `receive` returns, so that a flooded bus cannot block its caller


class BusConfig(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The section [bus] of a configuration file.

    interface: ``socketcan``, ``palpate``, or a python-can interface name (``virtual``, ``slcan`` ...).
    channel: the interface's channel; empty for the default (``can0`` for socketcan, the hub's default
    socket).
    bitrate: bit/s. SocketCAN takes its rate from the link's configuration; the hub refuses a rate that is not
        its own.
    data_bitrate: bit/s of the data phase of CAN FD frames; without it the bus is classic CAN. SocketCAN takes
        it from the link's configuration (``ip link set can0 type can ... dbitrate 5000000 fd on``); the hub
        refuses a rate that is not its own. BUS_DATA_BITRATE takes what the bus has (not from a file).
    clock: the file of a simulated hand's clock (simulated_clock.py); empty for the machine's own clock, as on
        every real bus.
    """

    interface: Annotated[str, msgspec.Meta(min_length=1)] = "socketcan"
    channel: str = ""
    bitrate: Annotated[int, msgspec.Meta(ge=10_000, le=1_000_000)] = 1_000_000
    data_bitrate: Annotated[int, msgspec.Meta(ge=1_000_000, le=8_000_000)] | None = None
    clock: str = ""


class Bus:
    """An open bus; `open_bus` makes it.

    Every failure is a `BusError`. Bus-off raises BusOffError from `receive` (a BusError from `send` where the
    driver reports it there); the bus may be used again once `counters.restarts` has grown. error_passive: the
    controller's last report. Frames with 29 bits, and CAN FD frames on a classic bus, are counted in
    `counters.foreign_frames` and left out, this program's own frames in `counters.own_echoes`; expects_echo:
    the caller's test for the latter, where the interface does not mark them.
    """

    def __init__(self, link: Link, config: BusConfig, name: str, *, echo: bool = False) -> None:
        self._link = link
        self.expects_echo: Callable[[CanFrame], bool] = lambda _: False
        self._drops_echoes = not echo
        self._where = f"{config.interface} bus {config.channel or '(default channel)'} of {name}"
        self._failure: BusError | None = None
        self.error_passive = False
        self.counters = BusCounters()

    def send(self, frames: Iterable[CanFrame]) -> None:
        """Queue the frames for transmission, in order.

        Raises BusError when the transmit queue stays full (ENOBUFS) for the link's `patience_s`, when the bus
        is off, or when it is down; the frames before the refused one are sent.
        """
        left = tuple(frames)
        left = left[self.try_send(left) :]
        while left:
            left = left[self._send_again(left) :]

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """Queue frames without waiting; return how many: fewer than given when the transmit queue is full.

        Raises BusError when the bus is off or down; if frames were queued before, only the next call raises.
        """
        try:
            count = self._link.try_send(frames)
        except BusError as error:
            raise BusError(f"{self._where}: cannot send: {error}") from error
        self.counters.sent += count
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
            self._receive_into(frames, timeout_s)
        except BusError as error:
            if not frames:
                raise
            self._failure = error
        self.counters.received += len(frames)
        return frames

    def accept(self, can_ids: Sequence[int]) -> None:
        """Receive only these 11-bit identifiers from now on. Raises BusError."""
        try:
            self._link.accept(can_ids)
        except BusError as error:
            raise BusError(f"{self._where}: cannot set filters: {error}") from error

    def fileno(self) -> int:
        """Return a descriptor that polls readable when `receive` has frames.

        Raises BusError on an interface without one (``virtual``).
        """
        try:
            return self._link.fileno()
        except BusError as error:
            raise BusError(f"{self._where} has {error}") from error

    def close(self) -> None:
        """Close the bus; a second call does nothing."""
        self._link.close()

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _send_again(self, frames: Sequence[CanFrame]) -> int:
        """Queue frames whose first one was refused; return how many. Raises BusError after `patience_s`."""
        back_off = BackOff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        waited_s, tries = 0.0, 1
        while waited_s < self._link.patience_s:
            pause_s = back_off.pause()
            self.counters.send_retries += 1
            time.sleep(pause_s)
            if count := self.try_send(frames):
                return count
            waited_s, tries = waited_s + pause_s, tries + 1
        raise BusError(
            f"{self._where}: transmit queue full, frame {frames[0].can_id:03X} refused "
            f"{tries} times: check the cabling and the bus load (palpate-host bus stats, or ip -s link)"
        )

    def _receive_into(self, frames: list[tuple[int, CanFrame]], timeout_s: float) -> None:
        try:
            for arrival in self._link.receive(timeout_s):
                self._sort_in(arrival, frames)
                if len(frames) == RECEIVE_BATCH:
                    return
        except BusOffError:
            raise
        except BusError as error:
            raise BusError(f"{self._where}: cannot receive: {error}") from error

    def _sort_in(self, arrival: Arrival, frames: list[tuple[int, CanFrame]]) -> None:
        stamp_us, frame, marked = arrival
        if frame is None:
            self.counters.foreign_frames += 1
        elif isinstance(frame, ErrorReport):
            self._note_error(frame)
        elif self._is_echo(frame, marked):
            self.counters.own_echoes += 1
        else:
            frames.append((stamp_us, frame))

    def _is_echo(self, frame: CanFrame, marked: bool) -> bool:
        """Return whether this program sent the frame, through this socket or an earlier one."""
        marks = self._link.marks
        if not self._drops_echoes or (not marked and marks is not Marks.NONE):
            return False
        return marks is Marks.PROGRAM or self.expects_echo(frame)

    def _note_error(self, report: ErrorReport) -> None:
        self.counters.error_frames += 1
        if report.error_class & CAN_ERR_RESTARTED:
            self.counters.restarts += 1
            self.error_passive = False
        if report.error_class & CAN_ERR_BUSOFF:
            raise BusOffError(
                f"{self._where}: the controller went bus-off: check wiring, termination and bit rate; it "
                "recovers by itself if the link restarts (ip link set can0 type can restart-ms 100)"
            )
        if report.error_class & CAN_ERR_CRTL:
            self.counters.receive_overruns += bool(report.controller & CRTL_RECEIVE_OVERFLOW)
            if report.controller & (CRTL_PASSIVE | CRTL_ACTIVE):
                self.error_passive = bool(report.controller & CRTL_PASSIVE)


def open_bus(
    config: BusConfig, name: str, accept_ids: Sequence[int] | None = None, *, echo: bool = False
) -> Bus:
    """Open the bus of `config`.

    name: of the program, for messages and the hub's statistics (``finger-1``).
    accept_ids: the 11-bit identifiers to receive, filtered by kernel, controller or hub; None for all.
    echo: receive also this program's own frames among them, stamped when they were on the wire.
    Raises BusError with the reason and the remedy.
    """
    if accept_ids is not None and not accept_ids:
        raise BusError(f"bus of {name}: accept_ids is empty: give an identifier, or None to receive all")
    settings = LinkSettings(
        channel=config.channel,
        name=name,
        bitrate=config.bitrate,
        data_bitrate=config.data_bitrate,
        accept_ids=None if accept_ids is None else tuple(accept_ids),
        echo=echo,
    )
    return Bus(_open_link(config, settings), config, name, echo=echo)


def open_error(config: BusConfig, name: str, error: Exception) -> BusError:
    """Return the error for a bus that cannot be opened, with the remedy where it is known."""
    reason = " ".join(str(error).split())
    if config.interface == "palpate":
        return BusError(reason)  # the hub's client states the remedy itself
    if isinstance(error, OSError) and error.errno == errno.EAFNOSUPPORT:
        return BusError(
            'this kernel has no SocketCAN: load can_raw, or set interface = "palpate" (local hub)'
        )
    return BusError(f"{config.interface} bus {config.channel or 'can0'} of {name} cannot be opened: {reason}")


def _open_link(config: BusConfig, settings: LinkSettings) -> Link:
    """Open the interface's own link, or python-can's bus where it has none."""
    opener = _opener(config.interface)
    try:
        return _open_python_can(config, settings) if opener is None else opener(settings)
    except OSError as error:
        raise open_error(config, settings.name, error) from error


@cache
def _opener(interface: str) -> LinkOpener | None:
    """Return what opens the interface's own link, None where python-can has to open it."""
    if interface == "socketcan":
        return SocketCanLink
    opener: LinkOpener | None = find_part(GROUP, interface)
    return opener


def _open_python_can(config: BusConfig, settings: LinkSettings) -> Link:
    import can  # noqa: PLC0415 - its import takes a quarter of a daemon's start

    from palpate_edge.can_bus.python_can_link import open_python_can  # noqa: PLC0415 - as above

    try:
        return open_python_can(config.interface, settings)
    except (can.CanError, ValueError) as error:
        raise open_error(config, settings.name, error) from error
