"""Negotiation of format, size and rate with a camera; only values read back from the driver count."""

from __future__ import annotations

import msgspec

from palpate_edge.capture.v4l2.device import VideoDevice
from palpate_edge.capture.v4l2.formats import PixelCode, PixelLayout
from palpate_edge.capture.v4l2.structures import (
    CAP_TIMEPERFRAME,
    FIELD_NONE,
    BufferType,
    Format,
    Ioctl,
    StreamParm,
)
from palpate_edge.common.errors import CaptureError

RATE_TOLERANCE = 0.05


class Agreement(msgspec.Struct, frozen=True):
    """The negotiated stream. fps: the rate that the driver reports; None when it reports none."""

    layout: PixelLayout
    fps: float | None


def negotiate(device: VideoDevice, width: int, height: int, fps: float, code: PixelCode | None) -> Agreement:
    """Set the camera to this size and the nearest rate, in format `code` or in the first that reaches `fps`.

    Raises CaptureError with the camera's formats when none that this program reads has this size.
    """
    offered = device.formats()
    candidates = [one for one in PixelCode if one.fourcc in offered and code in (None, one)]
    best: Agreement | None = None
    for candidate in candidates:
        agreement = _try(device, width, height, fps, candidate)
        if agreement is None:
            continue
        if reaches(agreement.fps, fps):
            return agreement
        if best is None or (agreement.fps or 0.0) > (best.fps or 0.0):
            best = agreement
    if best is None:
        raise CaptureError(_refusal(device, width, height, code, offered))
    return _try(device, width, height, fps, best.layout.code) or best  # set it again: another was tried since


def reaches(fps: float | None, wanted: float) -> bool:
    """Return whether a rate equals the wanted one within `RATE_TOLERANCE`."""
    return fps is not None and abs(fps - wanted) <= RATE_TOLERANCE * wanted


def _try(device: VideoDevice, width: int, height: int, fps: float, code: PixelCode) -> Agreement | None:
    wanted = Format(type=BufferType.VIDEO_CAPTURE)
    pix = wanted.fmt.pix
    pix.width, pix.height, pix.pixelformat, pix.field = width, height, code.fourcc, FIELD_NONE
    device.call(Ioctl.S_FMT, wanted)
    if (pix.width, pix.height, pix.pixelformat) != (width, height, code.fourcc):
        return None
    return Agreement(PixelLayout(code, width, height, pix.bytesperline), _set_rate(device, fps))


def _set_rate(device: VideoDevice, fps: float) -> float | None:
    parm = StreamParm(type=BufferType.VIDEO_CAPTURE)
    interval = parm.parm.capture.timeperframe
    interval.numerator, interval.denominator = 1000, round(1000 * fps)
    if not device.try_call(Ioctl.S_PARM, parm) or not parm.parm.capture.capability & CAP_TIMEPERFRAME:
        return None
    return interval.denominator / interval.numerator if interval.numerator else None


def _refusal(device: VideoDevice, width: int, height: int, code: PixelCode | None, offered: list[int]) -> str:
    wanted = code.value if code else "/".join(one.value for one in PixelCode)
    sizes = {
        f"{four_characters(fourcc)} " + " ".join(f"{w}x{h}" for w, h in device.sizes(fourcc))
        for fourcc in offered
    }
    return (
        f"camera {device.path} gives no {width}x{height} in {wanted}; it offers {', '.join(sorted(sizes))}: "
        "choose capture.camera.format, or calibrate for one of these sizes"
    )


def four_characters(fourcc: int) -> str:
    """Return the characters of a FourCC code, for example ``YUYV``."""
    return fourcc.to_bytes(4, "little").decode("ascii", "replace").strip()
