"""Controls and negotiation against a driver in memory that keeps V4L2's rules (tests/kernel: a real one)."""

from __future__ import annotations

import pytest
from linuxpy.video import raw

from palpate_edge.capture.v4l2 import controls
from palpate_edge.capture.v4l2.controls import FixedExposure, exposure_us, lock_controls
from palpate_edge.capture.v4l2.formats import PixelCode
from palpate_edge.capture.v4l2.negotiate import negotiate
from palpate_edge.capture.v4l2.structures import CAP_TIMEPERFRAME, Ioctl, QueryControl
from palpate_edge.common.errors import CaptureError

ID = raw.ControlID
WANTED = FixedExposure(exposure_us=5000, gain=12, white_balance_K=4600)


class Camera:
    """controls: {id: [minimum, maximum, value]}; modes: {code: {(width, height): fps}}."""

    path = "/dev/v4l/by-path/test"

    def __init__(self, ranges=None, modes=None, grudges=()):
        self.ranges = ranges or {}
        self.modes = modes or {}
        self.grudges = grudges
        self.set_order = []
        self.format = None

    def query_control(self, control_id):
        if control_id not in self.ranges:
            return None
        low, high, _ = self.ranges[control_id]
        return QueryControl(id=control_id, minimum=low, maximum=high)

    def get_control(self, control_id):
        return self.ranges[control_id][2]

    def set_control(self, control_id, value):
        if control_id in self.grudges:
            return False
        self.set_order.append(control_id)
        self.ranges[control_id][2] = value
        return True

    def formats(self):
        return [code.fourcc for code in self.modes]

    def sizes(self, fourcc):
        return next(list(sizes) for code, sizes in self.modes.items() if code.fourcc == fourcc)

    def call(self, request, argument):
        assert request is Ioctl.S_FMT
        pix = argument.fmt.pix
        code = next(code for code in self.modes if code.fourcc == pix.pixelformat)
        if (pix.width, pix.height) not in self.modes[code]:
            pix.width, pix.height = next(iter(self.modes[code]))
        pix.bytesperline = 2 * pix.width
        self.format = code, (pix.width, pix.height)

    def try_call(self, request, argument):
        assert request is Ioctl.S_PARM
        fps = self.modes[self.format[0]][self.format[1]]
        if fps is None:
            return False
        capture = argument.parm.capture
        wanted = capture.timeperframe.denominator / capture.timeperframe.numerator
        capture.capability = CAP_TIMEPERFRAME
        capture.timeperframe.numerator = 100
        capture.timeperframe.denominator = round(100 * min(wanted, fps))
        return True


def uvc_camera(**options):
    ranges = {
        ID.EXPOSURE_AUTO: [0, 3, 3],
        ID.EXPOSURE_ABSOLUTE: [1, 5000, 157],
        raw.ControlID.EXPOSURE_AUTO + 2: [0, 1, 1],
        ID.AUTOGAIN: [0, 1, 1],
        ID.GAIN: [0, 100, 30],
        ID.AUTO_WHITE_BALANCE: [0, 1, 1],
        ID.WHITE_BALANCE_TEMPERATURE: [2800, 6500, 5000],
    }
    return Camera(ranges, **options)


def test_everything_is_held_and_read_back():
    camera = uvc_camera()
    assert lock_controls(camera, WANTED) == []
    held = {control_id: value for control_id, (_, _, value) in camera.ranges.items()}
    assert held == {
        ID.EXPOSURE_AUTO: 1,
        ID.EXPOSURE_ABSOLUTE: 50,  # x 100 us
        raw.ControlID.EXPOSURE_AUTO + 2: 0,
        ID.AUTOGAIN: 0,
        ID.GAIN: 12,
        ID.AUTO_WHITE_BALANCE: 0,
        ID.WHITE_BALANCE_TEMPERATURE: 4600,
    }
    for automatic, value in (
        (ID.EXPOSURE_AUTO, ID.EXPOSURE_ABSOLUTE),
        (ID.AUTOGAIN, ID.GAIN),
        (ID.AUTO_WHITE_BALANCE, ID.WHITE_BALANCE_TEMPERATURE),
    ):
        assert camera.set_order.index(automatic) < camera.set_order.index(value)


def test_exposure_is_told_as_the_camera_has_it():
    camera = uvc_camera()
    assert exposure_us(camera) == 15_700
    lock_controls(camera, WANTED)
    assert exposure_us(camera) == 5_000
    del camera.ranges[ID.EXPOSURE_ABSOLUTE]
    assert exposure_us(camera) == 0


def test_values_that_are_not_asked_for_stay_and_their_automatics_go():
    camera = uvc_camera()
    assert lock_controls(camera, FixedExposure(None, None, None)) == []
    assert camera.ranges[ID.GAIN][2] == 30
    assert camera.ranges[ID.AUTOGAIN][2] == 0


def test_a_missing_control_is_told_and_no_fault():
    camera = uvc_camera()
    del camera.ranges[ID.AUTOGAIN]
    assert lock_controls(camera, WANTED) == ["the camera has no control for auto gain"]


def test_a_control_that_keeps_its_value_is_told():
    camera = uvc_camera(grudges=(ID.EXPOSURE_AUTO,))
    assert lock_controls(camera, WANTED) == ["auto exposure cannot be set"]


def test_a_rounded_value_is_told():
    camera = uvc_camera()
    camera.get_control = lambda control_id: 10 if control_id == ID.GAIN else camera.ranges[control_id][2]
    assert lock_controls(camera, WANTED) == ["gain is 10, requested was 12"]


def test_a_value_out_of_range_names_key_and_range():
    wanted = FixedExposure(exposure_us=5000, gain=101, white_balance_K=None)
    with pytest.raises(CaptureError, match=r"capture.camera.gain: 101 is out of range: .* takes 0 to 100"):
        lock_controls(uvc_camera(), wanted)


def test_the_identifiers_are_the_kernels():
    named = {
        controls.AUTO_EXPOSURE: "EXPOSURE_AUTO",
        controls.EXPOSURE: "EXPOSURE_ABSOLUTE",
        controls.AUTO_GAIN: "AUTOGAIN",
        controls.GAIN: "GAIN",
        controls.AUTO_WHITE_BALANCE: "AUTO_WHITE_BALANCE",
        controls.WHITE_BALANCE: "WHITE_BALANCE_TEMPERATURE",
    }
    for lock, name in named.items():
        assert lock.control_id == getattr(ID, name)
    assert controls.EXPOSURE_PRIORITY.control_id == ID.EXPOSURE_AUTO + 2  # v4l2-controls.h


VGA = (640, 480)
USB_2 = {PixelCode.YUYV: {VGA: 30.0}, PixelCode.MJPG: {VGA: 120.0}}


@pytest.mark.parametrize(("fps", "expected"), [(30, PixelCode.YUYV), (60, PixelCode.MJPG)])
def test_the_first_format_that_reaches_the_rate_is_taken(fps, expected):
    camera = Camera(modes=USB_2)
    agreed = negotiate(camera, *VGA, fps, None)
    assert agreed.layout.code is expected
    assert agreed.fps == fps
    assert camera.format == (expected, VGA)


def test_where_none_reaches_it_the_fastest_is_set_and_its_own_rate_told():
    camera = Camera(
        modes={PixelCode.MJPG: {VGA: 25.0}, PixelCode.YUYV: {VGA: 15.0}, PixelCode.GREY: {VGA: None}}
    )
    agreed = negotiate(camera, *VGA, 60, None)
    assert (agreed.layout.code, agreed.fps) == (PixelCode.MJPG, 25.0)
    assert camera.format == (PixelCode.MJPG, VGA)


def test_a_format_that_was_chosen_is_kept_though_it_is_slow():
    assert negotiate(Camera(modes=USB_2), *VGA, 60, PixelCode.YUYV).fps == 30


@pytest.mark.parametrize("code", [None, PixelCode.GREY])
def test_a_size_or_format_that_it_lacks_is_refused_with_what_it_has(code):
    camera = Camera(modes={PixelCode.YUYV: {(1280, 720): 30.0}})
    with pytest.raises(CaptureError, match=r"no 640x480 in .*; it offers YUYV 1280x720"):
        negotiate(camera, *VGA, 30, code)
