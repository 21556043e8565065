"""A link over python-can, for every interface without a link of its own: virtual, slcan, pcan and others."""

from __future__ import annotations

import errno
from collections.abc import Iterator, Sequence
from typing import Any

import can

from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame
from palpate_edge.can_bus.link import CAN_PATIENCE_S, Arrival, ErrorReport, LinkSettings, Marks, send_each
from palpate_edge.common.errors import BusError

_SOCKET_BUFFER_FULL = "Transmit buffer full"  # the text of some drivers, which set no error code


class PythonCanLink:
    """A bus that python-can has opened; see `Link`. carries_fd: it was opened with CAN FD."""

    patience_s = CAN_PATIENCE_S

    def __init__(self, bus: can.BusABC, marks: Marks = Marks.NONE, *, carries_fd: bool = False) -> None:
        self.marks = marks
        self._bus = bus
        self._carries_fd = carries_fd

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """See `Link.try_send`."""
        return send_each(frames, self._send, fd=self._carries_fd)

    def receive(self, timeout_s: float) -> Iterator[Arrival]:
        """See `Link.receive`."""
        try:
            message = self._bus.recv(timeout_s)
            while message is not None:
                yield round(message.timestamp * 1e6), self._parsed(message), not message.is_rx
                message = self._bus.recv(0)
        except can.CanError as error:
            raise _refusal(error) from error

    def accept(self, can_ids: Sequence[int]) -> None:
        """See `Link.accept`."""
        try:
            self._bus.set_filters(_filters(can_ids))
        except (can.CanError, OSError) as error:
            raise _refusal(error) from error

    def fileno(self) -> int:
        """See `Link.fileno`."""
        try:
            return self._bus.fileno()
        except NotImplementedError as error:
            raise BusError("no file descriptor to poll: use socketcan or palpate") from error

    def close(self) -> None:
        """See `Link.close`."""
        self._bus.shutdown()

    def _send(self, frame: CanFrame) -> bool:
        try:
            self._bus.send(message_of(frame))
        except can.CanError as error:
            if error.error_code == errno.ENOBUFS or _SOCKET_BUFFER_FULL in str(error):
                return False
            raise _refusal(error) from error
        return True

    def _parsed(self, message: can.Message) -> CanFrame | ErrorReport | None:
        if message.is_error_frame:
            controller = message.data[1] if len(message.data) > 1 else 0
            return ErrorReport(message.arbitration_id, controller)
        if message.is_extended_id or (message.is_fd and not self._carries_fd):
            return None
        data = bytes(message.dlc) if message.is_remote_frame else bytes(message.data)
        return CanFrame(message.arbitration_id, data, message.is_remote_frame, message.is_fd)


def open_python_can(interface: str, settings: LinkSettings) -> PythonCanLink:
    """Open an interface of python-can.

    Raises BusError for an interface that python-can does not have, can.CanError, OSError or ValueError when
    it cannot be opened.
    """
    if interface not in can.VALID_INTERFACES:
        raise BusError(
            f"bus of {settings.name}: python-can has no interface {interface!r} "
            f"(channel {settings.channel!r}): set socketcan or palpate"
        )
    options: dict[str, Any] = {"bitrate": settings.bitrate, "receive_own_messages": settings.echo}
    if interface == "palpate":  # an editable installation without the entry point of the hub's own link
        options["name"] = settings.name
    if settings.data_bitrate:
        options |= {"fd": True, "data_bitrate": settings.data_bitrate}
    bus = can.Bus(
        channel=settings.channel or None,
        interface=interface,
        can_filters=None if settings.accept_ids is None else _filters(settings.accept_ids),
        ignore_config=True,
        **options,
    )
    marks = Marks.PROGRAM if interface == "palpate" else Marks.NONE
    return PythonCanLink(bus, marks, carries_fd=bool(settings.data_bitrate))


def message_of(frame: CanFrame, **details: Any) -> can.Message:
    """Return the python-can message of a frame. details: further attributes of the message."""
    return can.Message(
        arbitration_id=frame.can_id,
        is_extended_id=False,
        is_remote_frame=frame.remote,
        is_fd=frame.fd,
        bitrate_switch=frame.fd,
        dlc=len(frame.data),
        data=frame.data,
        **details,
    )


def _filters(can_ids: Sequence[int]) -> list[can.typechecking.CanFilter]:
    return [{"can_id": can_id, "can_mask": MAX_STANDARD_ID, "extended": False} for can_id in can_ids]


def _refusal(error: Exception) -> BusError:
    return BusError(" ".join(str(error).split()))
