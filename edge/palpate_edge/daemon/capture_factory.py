"""The capture source of a configuration, checked against the calibration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from palpate_edge.calibration.calibration_file import AnySensor, check_sensor
from palpate_edge.capture.shared_memory import SharedMemorySource
from palpate_edge.capture.source import ReopeningSource, Source
from palpate_edge.capture.v4l2.controls import FixedExposure
from palpate_edge.capture.v4l2.formats import PixelCode
from palpate_edge.capture.v4l2.naming import find_camera, is_stable_name
from palpate_edge.capture.v4l2.source import CameraSettings, V4l2Source
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.daemon.capture_sources import find_opener
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.datasets.picture_sensor_file import read_picture_sensor
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration

DEFAULT_SIZE_PX, DEFAULT_FPS = (640, 480), 30.0

AnyCalibration = Calibration | PoseCalibration

SourceOpener = Callable[[FingertipConfig, AnyCalibration | None, LocalClock, Callable[[str], None]], Source]
"""Opens a source from configuration, calibration (None without one), the clock of exposure times, and a
function that takes one line for each setting that differs from the request. Raises CaptureError, DatasetError
or CalibrationError."""


def open_source(
    config: FingertipConfig,
    calibration: AnyCalibration | None,
    clock: LocalClock,
    report: Callable[[str], None],
) -> Source:
    """Open the configured source (a `SourceOpener` for all kinds).

    Raises DatasetError, CaptureError, or CalibrationError for frames of another sensor.
    """
    if config.estimator.sensor and calibration is not None:
        described = Path(config.estimator.sensor)
        read = read_sensor if isinstance(calibration, Calibration) else read_picture_sensor
        check_sensor(calibration.sensor, Path(config.estimator.calibration), read(described), described)
    opener: SourceOpener = find_opener(config.capture.source)
    return opener(config, calibration, clock, report)


def open_camera(
    config: FingertipConfig,
    calibration: AnyCalibration | None,
    clock: LocalClock,
    report: Callable[[str], None],
) -> Source:
    """Open the V4L2 camera, and again after a loss."""
    return ReopeningSource(camera_opener(config, calibration, clock, report))


def open_ring(
    config: FingertipConfig,
    calibration: AnyCalibration | None,
    clock: LocalClock,
    _report: Callable[[str], None],
) -> Source:
    """Open the ring of frames in shared memory, and again after a loss."""
    path = Path(config.capture.path)
    sensor = described_sensor(config, calibration)
    return ReopeningSource(lambda: SharedMemorySource(path, sensor, clock.at_monotonic_us, clock.now_us))


def open_recorded(
    config: FingertipConfig,
    calibration: AnyCalibration | None,
    clock: LocalClock,
    _report: Callable[[str], None],
) -> Source:
    """Open a recording, played in real time."""
    # A fingertip with a camera does not load what reads recordings.
    from palpate_edge.calibration.recording_match import check_recording  # noqa: PLC0415
    from palpate_edge.datasets.pose_dataset import open_pose_recording  # noqa: PLC0415
    from palpate_edge.datasets.recording import RealTimeSource, open_recording  # noqa: PLC0415

    path, grey = Path(config.capture.path), is_grey(calibration)
    if isinstance(calibration, PoseCalibration):
        recording = open_pose_recording(path, grey=grey)
    else:
        recording = open_recording(path, grey=grey)
    if isinstance(calibration, Calibration):
        check_recording(calibration, Path(config.estimator.calibration), recording.sensor, path)
    return RealTimeSource(recording, loop=config.capture.loop, clock_us=clock.now_us)


def camera_opener(
    config: FingertipConfig,
    calibration: AnyCalibration | None,
    clock: LocalClock,
    report: Callable[[str], None],
) -> Callable[[], V4l2Source]:
    """Return a function that finds and opens the camera; it reports each line only once."""
    capture = config.capture
    camera = capture.camera
    width, height, fps = requested_stream(config, calibration)
    settings = CameraSettings(
        width=width,
        height=height,
        fps=fps,
        code=None if camera.format == "any" else PixelCode(camera.format),
        grey=is_grey(calibration),
        fixed=FixedExposure(camera.exposure_us, camera.gain, camera.white_balance_K),
    )
    reported: set[str] = set()

    def report_once(line: str) -> None:
        if line not in reported:
            reported.add(line)
            report(line)

    if capture.path and not is_stable_name(capture.path):
        report(
            f"{capture.path} may be another camera after the next start: use a name in /dev/v4l/by-path, or "
            "set capture.camera.usb_serial"
        )
    return lambda: V4l2Source(find_camera(capture.path, camera.usb_serial), settings, clock, report_once)


def described_sensor(config: FingertipConfig, calibration: AnyCalibration | None) -> AnySensor | None:
    """Return the calibration's sensor, else that of estimator.sensor, else None. Raises DatasetError."""
    if calibration is not None:
        return calibration.sensor
    return read_sensor(Path(config.estimator.sensor)) if config.estimator.sensor else None


def requested_stream(config: FingertipConfig, calibration: AnyCalibration | None) -> tuple[int, int, float]:
    """Return width, height and frame rate to request of the camera.

    They are those of the sensor. Without one, capture.camera.width and height count, else `DEFAULT_SIZE_PX`.
    capture.camera.fps takes precedence. Raises DatasetError.
    """
    camera, sensor = config.capture.camera, described_sensor(config, calibration)
    if sensor is not None:
        return *sensor.image_size_px, camera.fps or sensor.camera.fps
    width, height = DEFAULT_SIZE_PX
    return camera.width or width, camera.height or height, camera.fps or DEFAULT_FPS


def is_grey(calibration: AnyCalibration | None) -> bool:
    """Return whether brightness alone distinguishes the beads from the skin; False without a calibration."""
    return calibration is not None and calibration.appearance.channel == "grey"
