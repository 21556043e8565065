"""Capture from a real V4L2 device, the kernel's vivid; v4l2-ctl reads it independently."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from kernel_guest.cameras import v4l2_ctl, vivid
from palpate_edge.capture.source import ReopeningSource
from palpate_edge.capture.v4l2.controls import FixedExposure
from palpate_edge.capture.v4l2.formats import PixelCode
from palpate_edge.capture.v4l2.naming import find_camera
from palpate_edge.capture.v4l2.source import CameraSettings, V4l2Source
from palpate_edge.common.errors import CameraLostError, CaptureError
from palpate_edge.common.local_clock import LocalClock

pytestmark = pytest.mark.vm


@contextmanager
def opened(camera, *, size=(640, 480), fps=25.0, code=None, grey=True, gain=None) -> Iterator:
    """Return the source and its reports."""
    reports: list[str] = []
    fixed = FixedExposure(exposure_us=None, gain=gain, white_balance_K=None)
    source = V4l2Source(camera, CameraSettings(*size, fps, code, grey, fixed), LocalClock(), reports.append)
    try:
        yield source, reports
    finally:
        source.close()


def test_a_camera_keeps_its_name_when_its_number_changes():
    for number in (6, 4):
        with vivid(vid_cap_nr=number) as name:
            assert find_camera(str(name), "").resolve() == Path(f"/dev/video{number}")
            with opened(name) as (source, _):
                assert source.read() is not None


def test_a_camera_that_is_not_there_names_those_that_are(camera):
    with pytest.raises(
        CameraLostError, match=f"no camera at .*usb-9.*: plug it in; present cameras: {camera}"
    ):
        find_camera("/dev/v4l/by-path/usb-9-video-index0", "")


@pytest.mark.parametrize("code", [PixelCode.YUYV, PixelCode.NV12, PixelCode.YU12])
def test_colours_are_those_of_the_colour_bars(camera, code):
    """100 % colour bars are white, yellow, cyan, green, magenta, red, blue, black from the left."""
    v4l2_ctl(camera, "-c", "test_pattern=1,osd_text_mode=2")
    with opened(camera, code=code, grey=False) as (source, _):
        image = source.read().image
    assert image.shape == (480, 640, 3)
    centres = image[100:400, 40::80].mean(axis=0)
    red = [255, 255, 0, 0, 255, 255, 0, 0]
    green = [255, 255, 255, 255, 0, 0, 0, 0]
    blue = [255, 0, 255, 0, 255, 0, 255, 0]
    np.testing.assert_allclose(centres, np.transpose([blue, green, red]), atol=6)


def test_grey_is_the_luma_a_stranger_reads(camera, tmp_path):
    v4l2_ctl(camera, "-c", "test_pattern=1,osd_text_mode=2")
    with opened(camera, code=PixelCode.GREY) as (source, _):
        image = source.read().image
    raw = tmp_path / "raw"
    v4l2_ctl(
        camera,
        "--set-fmt-video=width=640,height=480,pixelformat=GREY",
        *("--stream-mmap", "--stream-count=1", f"--stream-to={raw}"),
    )
    stranger = np.frombuffer(raw.read_bytes(), dtype=np.uint8).reshape(480, 640)
    assert stranger.std() > 50
    np.testing.assert_array_equal(image, stranger)


def test_the_size_must_be_one_that_the_camera_has(camera):
    refused = pytest.raises(CaptureError, match=r"gives no 322x242 in .*it offers .*YUYV .*640x480")
    with refused, opened(camera, size=(322, 242)):
        pass


def test_the_rate_is_told_as_it_is(camera):
    with opened(camera, fps=25.0) as (source, reports):
        assert source.agreement.fps == 25.0
        while source.measured_fps is None:
            source.read()
        # Exposures over time, those that an emulated machine was too slow for counted in.
        assert source.measured_fps == pytest.approx(25.0, rel=0.05)
        assert not [line for line in reports if "frames/s" in line]
    with opened(camera, fps=30.0) as (_, reports):  # vivid has no more at this size
        assert "gives 25.0 frames/s, 30.0 frames/s were requested" in "\n".join(reports)
        assert "25.000" in v4l2_ctl(camera, "--get-parm")


def test_exposures_are_stamped_by_the_kernel_on_our_clock(camera):
    clock = LocalClock()
    with opened(camera) as (source, reports):
        before_us = clock.now_us()
        stamps = [source.read().exposed_at_us for _ in range(10)]
        after_us = clock.now_us()
    assert stamps == sorted(set(stamps))
    # vivid stamps the time at which a frame was due, up to a period from the time at which it was made.
    assert before_us - 40_000 < stamps[0] < stamps[-1] < after_us + 40_000
    assert "no monotonic time stamps" not in "\n".join(reports)


def test_gain_is_held_and_its_automatic_switched_off(camera):
    v4l2_ctl(camera, "-c", "gain_automatic=1")
    with opened(camera, gain=77) as (_, reports):
        held = v4l2_ctl(camera, "-C", "gain_automatic,gain")
    assert held.split() == ["gain_automatic:", "0", "gain:", "77"]
    assert any("no control for exposure" in line for line in reports)
    refused = pytest.raises(
        CaptureError, match=r"capture\.camera\.gain: 999 is out of range: .* takes 0 to 255"
    )
    with refused, opened(camera, gain=999):
        pass


def test_lost_buffers_are_counted(camera):
    v4l2_ctl(camera, "-c", "percentage_of_dropped_buffers=50")
    with opened(camera) as (source, _):
        sequences = [source.read().sequence for _ in range(40)]
        assert source.dropped == sequences[-1] + 1 - len(sequences)
        assert source.dropped > 10


def test_a_damaged_buffer_is_not_a_frame(camera):
    with opened(camera) as (source, _):
        source.read()
        v4l2_ctl(camera, "-c", "inject_v4l2_buf_flag_error=1")
        for _ in range(30):
            source.read()
        assert source.damaged == 1


@pytest.fixture
def reopening(camera) -> Iterator[ReopeningSource]:
    """Return the camera as the daemon opens it."""
    settings = CameraSettings(640, 480, 25.0, None, True, FixedExposure(None, None, None))
    source = ReopeningSource(
        lambda: V4l2Source(find_camera(str(camera), ""), settings, LocalClock(), lambda _line: None)
    )
    yield source
    source.close()


def test_a_camera_that_is_unplugged_is_lost_and_opened_again(camera, reopening):
    last = reopening.read()
    v4l2_ctl(camera, "-c", "disconnect=1")  # unplugged until all programs have closed it
    with pytest.raises(CameraLostError, match="platform-vivid"):
        for _ in range(30):
            last = reopening.read()
    again = reopening.read()
    assert again.sequence > last.sequence
    assert again.exposed_at_us > last.exposed_at_us


def test_a_camera_whose_driver_leaves_is_lost_until_it_is_back(reopening):
    driver = Path("/sys/bus/platform/drivers/vivid")
    reopening.read()
    (driver / "unbind").write_text("vivid.0")
    for _ in range(2):  # lost while in use, then not there
        with pytest.raises(CameraLostError, match=r"check its cable|plug it in"):
            for _ in range(30):
                reopening.read()
    (driver / "bind").write_text("vivid.0")
    subprocess.run(["udevadm", "settle"], check=True)
    assert reopening.read() is not None
