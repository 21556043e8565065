"""The fingertip's configuration file: TOML; unknown keys are errors, paths are relative to the file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.config_file import read_toml
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.type_text import value_text
from palpate_edge.daemon.capture_sources import OWN_SOURCES, source_names
from palpate_edge.node.object_dictionary import UNCONFIGURED_NODE_ID

LARGEST_NODE_ID = 127  # CiA 301


class CameraConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of a V4L2 camera. usb_serial: the camera's serial number, in place of capture.path.

    format: ``any`` takes the first that reaches fps. fps: 0 for the calibration's. exposure_us, gain,
    white_balance_K: fixed at this value, or at the camera's present value when not given. width, height: of
    the images when there is neither a calibration nor estimator.sensor.
    """

    usb_serial: str = ""
    format: Literal["any", "GREY", "NV12", "YU12", "YUYV", "MJPG"] = "any"
    fps: Annotated[float, msgspec.Meta(ge=0, le=1000)] = 0.0
    exposure_us: Annotated[int, msgspec.Meta(ge=1, le=1_000_000)] | None = None
    gain: int | None = None
    white_balance_K: Annotated[int, msgspec.Meta(ge=1000, le=20_000)] | None = None
    width: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 0
    height: Annotated[int, msgspec.Meta(ge=0, le=10_000)] = 0


class CaptureConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The source of frames.

    source: ``recorded`` (a press dataset, a folder of images or a video at `path`, played in real time),
    ``v4l2`` (the camera at `path` with the settings in `camera`), ``shared_memory`` (the ring of frames at
    `path` that another process writes), or the source of another package (capture_sources.py); loop: restart
    a recording at its end.
    timeout_ms: after this time without a frame the contact is withdrawn and the camera counts as stalled.
    """

    source: str
    path: str = ""
    loop: bool = False
    timeout_ms: Annotated[int, msgspec.Meta(ge=20, le=10_000)] = 200
    camera: CameraConfig = CameraConfig()


class RecordConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Recordings of ``palpate-edge record``: their folder and size; beyond it the oldest frames are
    deleted."""

    folder: str = "recordings"
    megabytes: Annotated[int, msgspec.Meta(ge=1, le=1_000_000)] = 500
    seconds: Annotated[float, msgspec.Meta(gt=0)] = 60.0


class EstimatorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The estimator. calibration: file made by ``palpate-edge calibrate``; sensor: the sensor.toml that it
    must match, empty for no check; method: ``paper``, ``corrected``, or ``best`` (corrected when the
    calibration has a model).

    calibration_required: False: while the file does not exist, the daemon runs without a calibration, and no
    contact is valid. An empty `calibration` means the same.
    """

    calibration: str = ""
    sensor: str = ""
    method: Literal["best", "paper", "corrected"] = "best"
    calibration_required: bool = True


class NodeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The CANopen node. id: 1..127, by convention 0x10-0x1F for fingertips; 255: LSS assigns the id.

    serial_number: 1018h:04, by which LSS distinguishes fingertips; None for one made from the board's own and
    the fingertip's name. parameters: the file for parameters that a
    master stores (1010h); without one storing is refused.
    """

    id: int
    serial_number: Annotated[int, msgspec.Meta(ge=0, le=0xFFFF_FFFF)] | None = None
    parameters: str = ""


class IlluminationConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The illumination controller. i2c_bus: N of /dev/i2c-N; None without a controller."""

    i2c_bus: Annotated[int, msgspec.Meta(ge=0, le=255)] | None = None
    address: Annotated[int, msgspec.Meta(ge=0x08, le=0x77)] = 0x2A


class FingertipConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file of ``palpate-edge run --config``. health: path of the health report, empty for the default."""

    name: str
    capture: CaptureConfig
    node: NodeConfig
    bus: BusConfig
    estimator: EstimatorConfig = EstimatorConfig()
    record: RecordConfig = RecordConfig()
    illumination: IlluminationConfig = IlluminationConfig()
    health: str = ""


def read_config(path: Path) -> FingertipConfig:
    """Read a fingertip's configuration. Raises ConfigError naming file and key."""
    config = read_toml(path, FingertipConfig, guide="docs/configuration.md lists every key of a fingertip")
    folder = path.resolve().parent
    _check_node_id(path, config.node.id)
    _check_capture(path, config.capture)
    capture_path = str(folder / config.capture.path) if config.capture.path else ""
    capture = msgspec.structs.replace(config.capture, path=capture_path)
    estimator = msgspec.structs.replace(
        config.estimator,
        calibration=str(folder / config.estimator.calibration) if config.estimator.calibration else "",
        sensor=str(folder / config.estimator.sensor) if config.estimator.sensor else "",
    )
    parameters = str(folder / config.node.parameters) if config.node.parameters else ""
    node = msgspec.structs.replace(config.node, parameters=parameters)
    record = msgspec.structs.replace(config.record, folder=str(folder / config.record.folder))
    health = str(folder / config.health) if config.health else ""
    return msgspec.structs.replace(
        config, capture=capture, estimator=estimator, node=node, record=record, health=health
    )


def _check_node_id(path: Path, node_id: int) -> None:
    """Check the range, which the type cannot express: msgspec takes no bounds beside a Literal."""
    if not (1 <= node_id <= LARGEST_NODE_ID or node_id == UNCONFIGURED_NODE_ID):
        raise ConfigError(
            f"{path}: node.id = {node_id} is out of range: it must be a whole number from 1 to "
            f"{LARGEST_NODE_ID}, or {UNCONFIGURED_NODE_ID}"
        )


def _check_capture(path: Path, capture: CaptureConfig) -> None:
    """Check that the source is known and has exactly one name, which the types cannot express."""
    # Names of other packages' sources are read only when needed: reading them takes 80 M instructions.
    if capture.source not in OWN_SOURCES and capture.source not in source_names():
        raise ConfigError(
            f"{path}: capture.source = {value_text(capture.source)} is not one of {', '.join(source_names())}"
        )
    if capture.source == "v4l2" and bool(capture.path) == bool(capture.camera.usb_serial):
        raise ConfigError(
            f"{path}: a v4l2 camera has one name: give capture.path (/dev/v4l/by-path/...) or "
            "capture.camera.usb_serial"
        )
    if capture.source in ("recorded", "shared_memory") and not capture.path:
        raise ConfigError(f"{path}: capture.path is missing: name the recording or the ring of frames")
