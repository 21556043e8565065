"""Fixed exposure, gain and white balance: automatic control would change the beads' brightness.

Each control is set to manual or to its value and read back. A missing control or a rounded value is reported
and accepted; a value outside the control's range is an error.
"""

from __future__ import annotations

from typing import Protocol

import msgspec

from palpate_edge.capture.v4l2.structures import ControlFlag, QueryControl
from palpate_edge.common.errors import CaptureError

EXPOSURE_UNIT_US = 100  # of V4L2_CID_EXPOSURE_ABSOLUTE
EXPOSURE_MANUAL = 1  # V4L2_EXPOSURE_MANUAL


class CameraControl(msgspec.Struct, frozen=True):
    """One V4L2_CID_*: identifier, name in messages, and key of the configuration that sets it."""

    control_id: int
    name: str
    key: str = ""


AUTO_EXPOSURE = CameraControl(0x009A_0901, "auto exposure")
EXPOSURE = CameraControl(0x009A_0902, "exposure", "capture.camera.exposure_us")
EXPOSURE_PRIORITY = CameraControl(0x009A_0903, "exposure priority over frame rate")
AUTO_GAIN = CameraControl(0x0098_0912, "auto gain")
GAIN = CameraControl(0x0098_0913, "gain", "capture.camera.gain")
AUTO_WHITE_BALANCE = CameraControl(0x0098_090C, "auto white balance")
WHITE_BALANCE = CameraControl(0x0098_091A, "white balance temperature", "capture.camera.white_balance_K")


class FixedExposure(msgspec.Struct, frozen=True):
    """The values to hold; None keeps the camera's present value. Automatic control is disabled in any
    case."""

    exposure_us: int | None
    gain: int | None
    white_balance_K: int | None


class ControlDevice(Protocol):
    """The methods of VideoDevice that controls need."""

    def query_control(self, control_id: int) -> QueryControl | None: ...
    def get_control(self, control_id: int) -> int | None: ...
    def set_control(self, control_id: int, value: int) -> bool: ...


def lock_controls(device: ControlDevice, fixed: FixedExposure) -> list[str]:
    """Fix exposure, gain and white balance; return one line for each difference from the request.

    Automatic control is disabled first, since drivers refuse a value while it is enabled. Raises CaptureError
    for a value out of range.
    """
    exposure = None if fixed.exposure_us is None else round(fixed.exposure_us / EXPOSURE_UNIT_US)
    wanted: list[tuple[CameraControl, int | None]] = [
        (AUTO_EXPOSURE, EXPOSURE_MANUAL),
        (EXPOSURE_PRIORITY, 0),
        (EXPOSURE, exposure),
        (AUTO_GAIN, 0),
        (GAIN, fixed.gain),
        (AUTO_WHITE_BALANCE, 0),
        (WHITE_BALANCE, fixed.white_balance_K),
    ]
    findings = (_set(device, control, value) for control, value in wanted if value is not None)
    return [finding for finding in findings if finding]


def exposure_us(device: ControlDevice) -> int:
    """Return the camera's present exposure time in us; 0 when it has no such control."""
    query = device.query_control(EXPOSURE.control_id)
    if query is None or query.flags & ControlFlag.DISABLED:
        return 0
    return EXPOSURE_UNIT_US * (device.get_control(EXPOSURE.control_id) or 0)


def _set(device: ControlDevice, control: CameraControl, value: int) -> str:
    query = device.query_control(control.control_id)
    if query is None or query.flags & (ControlFlag.DISABLED | ControlFlag.READ_ONLY):
        return f"the camera has no control for {control.name}"
    if control.key and not query.minimum <= value <= query.maximum:
        raise CaptureError(
            f"{control.key}: {value} is out of range: the camera's {control.name} takes {query.minimum} to "
            f"{query.maximum}{' (x 100 us)' if control is EXPOSURE else ''}"
        )
    accepted = device.set_control(control.control_id, value)
    held = device.get_control(control.control_id)
    if held == value:
        return ""
    return f"{control.name} is {held}, requested was {value}" if accepted else f"{control.name} cannot be set"
