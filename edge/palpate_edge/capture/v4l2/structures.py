"""The structures and ioctl numbers of ``linux/videodev2.h`` that a capture stream needs, for 64-bit kernels.

Names are the kernel's without their prefix. "The Linux Media Infrastructure userspace API", part I, describes
each field.
"""

from __future__ import annotations

import ctypes
from ctypes import (
    Structure,
    Union,
    c_char,
    c_int32,
    c_int64,
    c_uint8,
    c_uint32,
    c_uint64,
)
from enum import IntEnum, IntFlag


class BufferType(IntEnum):
    VIDEO_CAPTURE = 1


class Memory(IntEnum):
    MMAP = 1


class Capability(IntFlag):
    """Bits of Capabilities.device_caps."""

    VIDEO_CAPTURE = 0x0000_0001
    STREAMING = 0x0400_0000


class BufferFlag(IntFlag):
    ERROR = 0x0040
    TIMESTAMP_MASK = 0xE000
    TIMESTAMP_MONOTONIC = 0x2000


class ControlFlag(IntFlag):
    DISABLED = 0x0001
    READ_ONLY = 0x0004


FIELD_NONE = 1  # progressive
CAP_TIMEPERFRAME = 0x1000  # of CaptureParm.capability
FRAME_SIZE_DISCRETE = 1


class Capabilities(Structure):
    _fields_ = [
        ("driver", c_char * 16),
        ("card", c_char * 32),
        ("bus_info", c_char * 32),
        ("version", c_uint32),
        ("capabilities", c_uint32),
        ("device_caps", c_uint32),
        ("reserved", c_uint32 * 3),
    ]


class FormatDescription(Structure):
    _fields_ = [
        ("index", c_uint32),
        ("type", c_uint32),
        ("flags", c_uint32),
        ("description", c_char * 32),
        ("pixelformat", c_uint32),
        ("mbus_code", c_uint32),
        ("reserved", c_uint32 * 3),
    ]


class FrameSize(Structure):
    """A frame size. width, height: of a discrete size; the union's stepwise range is not used."""

    _fields_ = [
        ("index", c_uint32),
        ("pixel_format", c_uint32),
        ("type", c_uint32),
        ("width", c_uint32),
        ("height", c_uint32),
        ("stepwise_rest", c_uint32 * 4),
        ("reserved", c_uint32 * 2),
    ]


class PixelFormat(Structure):
    _fields_ = [
        ("width", c_uint32),
        ("height", c_uint32),
        ("pixelformat", c_uint32),
        ("field", c_uint32),
        ("bytesperline", c_uint32),
        ("sizeimage", c_uint32),
        ("colorspace", c_uint32),
        ("priv", c_uint32),
        ("flags", c_uint32),
        ("ycbcr_enc", c_uint32),
        ("quantization", c_uint32),
        ("xfer_func", c_uint32),
    ]


class _FormatUnion(Union):
    # raw_data has the kernel's alignment of 8, which its v4l2_window brings in by its pointers
    _fields_ = [("pix", PixelFormat), ("raw_data", c_uint64 * 25)]


class Format(Structure):
    _fields_ = [("type", c_uint32), ("fmt", _FormatUnion)]


class Fraction(Structure):
    _fields_ = [("numerator", c_uint32), ("denominator", c_uint32)]


class CaptureParm(Structure):
    _fields_ = [
        ("capability", c_uint32),
        ("capturemode", c_uint32),
        ("timeperframe", Fraction),
        ("extendedmode", c_uint32),
        ("readbuffers", c_uint32),
        ("reserved", c_uint32 * 4),
    ]


class _ParmUnion(Union):
    _fields_ = [("capture", CaptureParm), ("raw_data", c_uint8 * 200)]


class StreamParm(Structure):
    _fields_ = [("type", c_uint32), ("parm", _ParmUnion)]


class RequestBuffers(Structure):
    _fields_ = [
        ("count", c_uint32),
        ("type", c_uint32),
        ("memory", c_uint32),
        ("capabilities", c_uint32),
        ("flags", c_uint8),
        ("reserved", c_uint8 * 3),
    ]


class Timeval(Structure):
    _fields_ = [("tv_sec", c_int64), ("tv_usec", c_int64)]


class Timecode(Structure):
    _fields_ = [
        ("type", c_uint32),
        ("flags", c_uint32),
        ("frames", c_uint8),
        ("seconds", c_uint8),
        ("minutes", c_uint8),
        ("hours", c_uint8),
        ("userbits", c_uint8 * 4),
    ]


class _BufferUnion(Union):
    _fields_ = [("offset", c_uint32), ("userptr", c_uint64)]


class Buffer(Structure):
    _fields_ = [
        ("index", c_uint32),
        ("type", c_uint32),
        ("bytesused", c_uint32),
        ("flags", c_uint32),
        ("field", c_uint32),
        ("timestamp", Timeval),
        ("timecode", Timecode),
        ("sequence", c_uint32),
        ("memory", c_uint32),
        ("m", _BufferUnion),
        ("length", c_uint32),
        ("reserved2", c_uint32),
        ("request_fd", c_int32),
    ]


class QueryControl(Structure):
    _fields_ = [
        ("id", c_uint32),
        ("type", c_uint32),
        ("name", c_char * 32),
        ("minimum", c_int32),
        ("maximum", c_int32),
        ("step", c_int32),
        ("default_value", c_int32),
        ("flags", c_uint32),
        ("reserved", c_uint32 * 2),
    ]


class Control(Structure):
    _fields_ = [("id", c_uint32), ("value", c_int32)]


_WRITE, _READ = 1, 2


def _ioc(direction: int, number: int, argument: type[Structure] | type[ctypes.c_int]) -> int:
    """Return the request number: _IOC of ``asm-generic/ioctl.h`` (x86-64 and aarch64), video group 'V'."""
    return direction << 30 | ctypes.sizeof(argument) << 16 | ord("V") << 8 | number


class Ioctl(IntEnum):
    """VIDIOC_* requests."""

    QUERYCAP = _ioc(_READ, 0, Capabilities)
    ENUM_FMT = _ioc(_READ | _WRITE, 2, FormatDescription)
    S_FMT = _ioc(_READ | _WRITE, 5, Format)
    REQBUFS = _ioc(_READ | _WRITE, 8, RequestBuffers)
    QUERYBUF = _ioc(_READ | _WRITE, 9, Buffer)
    QBUF = _ioc(_READ | _WRITE, 15, Buffer)
    DQBUF = _ioc(_READ | _WRITE, 17, Buffer)
    STREAMON = _ioc(_WRITE, 18, ctypes.c_int)
    STREAMOFF = _ioc(_WRITE, 19, ctypes.c_int)
    S_PARM = _ioc(_READ | _WRITE, 22, StreamParm)
    G_CTRL = _ioc(_READ | _WRITE, 27, Control)
    S_CTRL = _ioc(_READ | _WRITE, 28, Control)
    QUERYCTRL = _ioc(_READ | _WRITE, 36, QueryControl)
    ENUM_FRAMESIZES = _ioc(_READ | _WRITE, 74, FrameSize)
