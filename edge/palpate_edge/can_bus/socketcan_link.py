"""CAN sockets of the Linux kernel, without python-can: its import takes a quarter of a daemon's start.

Source: Documentation/networking/can.rst, linux/can.h, linux/can/raw.h and linux/can/error.h of the kernel.
"""

from __future__ import annotations

import errno
import fcntl
import select
import socket
from collections.abc import Iterator, Sequence
from struct import Struct

from palpate_edge.can_bus.can_frame import MAX_STANDARD_ID, CanFrame
from palpate_edge.can_bus.link import (
    CAN_ERR_CRTL,
    CAN_FD_FLAGS,
    CAN_PATIENCE_S,
    CRTL_RECEIVE_OVERFLOW,
    Arrival,
    ErrorReport,
    LinkSettings,
    Marks,
    send_each,
)
from palpate_edge.common.errors import BusError

DEFAULT_CHANNEL = "can0"

# struct can_frame and canfd_frame: identifier with flags U32, length U8, FD flags U8, two bytes zero, data.
_CLASSIC, _FD = Struct("=IBBxx8s"), Struct("=IBBxx64s")
_CAN_RAW_ERR_FILTER = 2
_MAX_FILTERS = 512  # CAN_RAW_FILTER_MAX
_FILTER = Struct("=II")
_SO_TIMESTAMPNS = 35
_TIMESPEC = Struct("@ll")
_SO_RXQ_OVFL = 40
_DROPPED = Struct("@I")
_ANCILLARY_BYTES = socket.CMSG_SPACE(_TIMESPEC.size) + socket.CMSG_SPACE(_DROPPED.size)
_SO_RCVBUFFORCE = 33
_BUFFER_BYTES = 1 << 20  # half a second of a full bus; the kernel's default holds 477 frames
_SIOCGIFMTU = 0x8921
_IFREQ = Struct("16si20x")  # name, MTU


class SocketCanLink:
    """A raw CAN socket on one interface; see `Link`.

    Raises OSError when the kernel has no CAN or the interface does not exist, BusError for CAN FD on an
    interface that carries classic frames only.
    """

    marks = Marks.MACHINE
    patience_s = CAN_PATIENCE_S

    def __init__(self, settings: LinkSettings) -> None:
        channel = settings.channel or DEFAULT_CHANNEL
        self._carries_fd = settings.data_bitrate is not None
        self._wanted: frozenset[int] | None = None
        self._dropped = 0
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_RECV_OWN_MSGS, settings.echo)
            self._socket.setsockopt(socket.SOL_CAN_RAW, _CAN_RAW_ERR_FILTER, socket.CAN_ERR_MASK)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
            _enlarge_buffer(self._socket)
            if settings.accept_ids is not None:
                self._set_filters(settings.accept_ids)
            if settings.data_bitrate:
                _check_carries_fd(self._socket, channel, settings)
            if self._carries_fd:
                self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
            self._socket.bind((channel,))
        except (OSError, BusError):
            self._socket.close()
            raise

    def try_send(self, frames: Sequence[CanFrame]) -> int:
        """See `Link.try_send`."""
        return send_each(frames, self._send, fd=self._carries_fd)

    def receive(self, timeout_s: float) -> Iterator[Arrival]:
        """See `Link.receive`."""
        try:
            if timeout_s > 0:
                select.select([self._socket], [], [], timeout_s)  # poll() would round up to 1 ms
            while True:
                packet, ancillary, flags, _ = self._socket.recvmsg(_FD.size, _ANCILLARY_BYTES)
                frame = _parsed(packet)
                seconds, nanoseconds = _TIMESPEC.unpack_from(ancillary[0][2])
                stamp_us = seconds * 1_000_000 + nanoseconds // 1000
                if len(ancillary) > 1:  # the number of frames that did not fit into the socket's buffer
                    (dropped,) = _DROPPED.unpack_from(ancillary[1][2])
                    if dropped != self._dropped:
                        self._dropped = dropped
                        yield stamp_us, ErrorReport(CAN_ERR_CRTL, CRTL_RECEIVE_OVERFLOW), False
                if self._wanted is None or self._is_wanted(frame):
                    yield stamp_us, frame, bool(flags & socket.MSG_DONTROUTE)
        except BlockingIOError:
            return
        except OSError as error:
            raise _refusal(error) from error

    def accept(self, can_ids: Sequence[int]) -> None:
        """See `Link.accept`."""
        try:
            self._set_filters(can_ids)
        except OSError as error:
            raise _refusal(error) from error

    def fileno(self) -> int:
        """See `Link.fileno`."""
        return self._socket.fileno()

    def close(self) -> None:
        """See `Link.close`."""
        self._socket.close()

    def _send(self, frame: CanFrame) -> bool:
        try:
            self._socket.send(_packed(frame))
        except BlockingIOError:  # the socket's own buffer
            return False
        except OSError as error:
            if error.errno == errno.ENOBUFS:  # the interface's queue
                return False
            raise _refusal(error) from error
        return True

    def _set_filters(self, can_ids: Sequence[int]) -> None:
        """Let the kernel filter; more identifiers than it takes are filtered here."""
        in_kernel = len(can_ids) <= _MAX_FILTERS
        self._wanted = None if in_kernel else frozenset(can_ids)
        mask = MAX_STANDARD_ID | socket.CAN_EFF_FLAG
        pairs = [(can_id, mask) for can_id in can_ids] if in_kernel else [(0, 0)]
        filters = b"".join(_FILTER.pack(*pair) for pair in pairs)
        self._socket.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)

    def _is_wanted(self, frame: CanFrame | ErrorReport | None) -> bool:
        if isinstance(frame, CanFrame):
            return self._wanted is None or frame.can_id in self._wanted
        return frame is not None


def _enlarge_buffer(opened: socket.socket) -> None:
    """Enlarge the receive buffer, up to net.core.rmem_max where the program may not exceed it."""
    try:
        opened.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, _BUFFER_BYTES)
    except PermissionError:
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)


def _packed(frame: CanFrame) -> bytes:
    identifier = frame.can_id | (socket.CAN_RTR_FLAG if frame.remote else 0)
    if frame.fd:
        return _FD.pack(identifier, len(frame.data), CAN_FD_FLAGS, frame.data)
    return _CLASSIC.pack(identifier, len(frame.data), 0, frame.data)


def _parsed(packet: bytes) -> CanFrame | ErrorReport | None:
    is_fd = len(packet) == _FD.size
    identifier, length, _, data = (_FD if is_fd else _CLASSIC).unpack(packet)
    if identifier & socket.CAN_ERR_FLAG:
        return ErrorReport(identifier & socket.CAN_ERR_MASK, data[1])
    if identifier & socket.CAN_EFF_FLAG:
        return None
    can_id = identifier & MAX_STANDARD_ID
    return CanFrame(can_id, data[:length], bool(identifier & socket.CAN_RTR_FLAG), is_fd)


def _check_carries_fd(opened: socket.socket, channel: str, settings: LinkSettings) -> None:
    """Raise BusError with the command that enables CAN FD; OSError when the interface does not exist."""
    request = _IFREQ.pack(channel.encode(), 0)
    _, mtu = _IFREQ.unpack(fcntl.ioctl(opened, _SIOCGIFMTU, request))
    if mtu >= _FD.size:
        return
    command = (
        f"ip link set {channel} type can bitrate {settings.bitrate} dbitrate {settings.data_bitrate} fd on"
    )
    if channel.startswith("vcan"):
        command = f"ip link set {channel} mtu {_FD.size}"
    raise BusError(
        f"bus.data_bitrate is set, and {channel} of {settings.name} carries classic CAN frames only: "
        f"take the interface down and enable CAN FD ({command}), or remove bus.data_bitrate"
    )


def _refusal(error: OSError) -> BusError:
    return BusError(error.strerror or str(error))
