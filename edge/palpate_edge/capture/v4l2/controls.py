"""Exposure, gain and white balance held fixed: a camera that adapts changes the beads' brightness.

Each control is set to manual or to its value and read back. What a camera lacks or rounds is told once and
is no fault; a value outside the control's range is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from palpate_edge.capture.v4l2.structures import ControlFlag, QueryControl
from palpate_edge.common.errors import CaptureError

EXPOSURE_UNIT_US = 100  # of V4L2_CID_EXPOSURE_ABSOLUTE
EXPOSURE_MANUAL = 1  # V4L2_EXPOSURE_MANUAL


@dataclass(frozen=True, slots=True)
class Lock:
    """One V4L2_CID_*: its identifier, its name in messages, the configuration's key it comes from."""

    control_id: int
    name: str
    key: str = ""


AUTO_EXPOSURE = Lock(0x009A_0901, "auto exposure")
EXPOSURE = Lock(0x009A_0902, "exposure", "capture.camera.exposure_us")
EXPOSURE_PRIORITY = Lock(0x009A_0903, "exposure priority over frame rate")
AUTO_GAIN = Lock(0x0098_0912, "auto gain")
GAIN = Lock(0x0098_0913, "gain", "capture.camera.gain")
AUTO_WHITE_BALANCE = Lock(0x0098_090C, "auto white balance")
WHITE_BALANCE = Lock(0x0098_091A, "white balance temperature", "capture.camera.white_balance_K")


@dataclass(frozen=True, slots=True)
class FixedExposure:
    """What to hold; None leaves a value as it is, with its automatic switched off all the same."""

    exposure_us: int | None
    gain: int | None
    white_balance_K: int | None


class ControlDevice(Protocol):
    """The part of a Device that controls need."""

    def query_control(self, control_id: int) -> QueryControl | None: ...
    def get_control(self, control_id: int) -> int | None: ...
    def set_control(self, control_id: int, value: int) -> bool: ...


def lock_controls(device: ControlDevice, fixed: FixedExposure) -> list[str]:
    """Hold exposure, gain and white balance; returns what is not as asked, a line each.

    Automatics go first: a driver refuses a value while its automatic is on. Raises CaptureError for a value
    out of range.
    """
    exposure = None if fixed.exposure_us is None else round(fixed.exposure_us / EXPOSURE_UNIT_US)
    wanted: list[tuple[Lock, int | None]] = [
        (AUTO_EXPOSURE, EXPOSURE_MANUAL),
        (EXPOSURE_PRIORITY, 0),
        (EXPOSURE, exposure),
        (AUTO_GAIN, 0),
        (GAIN, fixed.gain),
        (AUTO_WHITE_BALANCE, 0),
        (WHITE_BALANCE, fixed.white_balance_K),
    ]
    findings = (_set(device, lock, value) for lock, value in wanted if value is not None)
    return [finding for finding in findings if finding]


def exposure_us(device: ControlDevice) -> int:
    """The camera's exposure time as it is now; 0 when it has no control that tells."""
    query = device.query_control(EXPOSURE.control_id)
    if query is None or query.flags & ControlFlag.DISABLED:
        return 0
    return EXPOSURE_UNIT_US * (device.get_control(EXPOSURE.control_id) or 0)


def _set(device: ControlDevice, lock: Lock, value: int) -> str:
    query = device.query_control(lock.control_id)
    if query is None or query.flags & (ControlFlag.DISABLED | ControlFlag.READ_ONLY):
        return f"the camera has no control for {lock.name}"
    if lock.key and not query.minimum <= value <= query.maximum:
        raise CaptureError(
            f"{lock.key}: the camera's {lock.name} goes from {query.minimum} to {query.maximum}"
            f"{' (x 100 us)' if lock is EXPOSURE else ''}, not {value}"
        )
    accepted = device.set_control(lock.control_id, value)
    held = device.get_control(lock.control_id)
    if held == value:
        return ""
    return f"{lock.name} is {held}, not {value} as asked" if accepted else f"{lock.name} cannot be set"
