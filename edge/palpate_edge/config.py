"""The fingertip's configuration file: TOML, every key known, every path relative to the file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec

from palpate_edge.bus import BusConfig
from palpate_edge.errors import ConfigError

NodeId = Annotated[int, msgspec.Meta(ge=1, le=127)]


class CaptureConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where frames come from.

    source: ``recorded`` (a press dataset, a folder of images or a video at `path`, played in real time);
    loop: start over at the recording's end.
    """

    source: Literal["recorded"]
    path: str
    loop: bool = False


class EstimatorConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """calibration: file made by ``palpate-edge calibrate``; sensor: the sensor.toml it must belong to;
    method: ``paper``, ``corrected``, or ``best`` (corrected when the calibration holds a model)."""

    calibration: str
    sensor: str = ""
    method: Literal["best", "paper", "corrected"] = "best"


class NodeConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """id: CANopen node id, 1..127; fingertips are 0x10-0x1F by convention."""

    id: NodeId


class FingertipConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of a ``palpate-edge run --config`` file."""

    name: str
    capture: CaptureConfig
    estimator: EstimatorConfig
    node: NodeConfig
    bus: BusConfig


def read_config(path: Path) -> FingertipConfig:
    """Read a fingertip's configuration. Raises ConfigError naming file and key."""
    try:
        config = msgspec.toml.decode(path.read_bytes(), type=FingertipConfig)
    except FileNotFoundError:
        raise ConfigError(f"{path} is missing: write it as in docs/configuration.md") from None
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from None
    except (msgspec.DecodeError, ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: {error}: correct it as in docs/configuration.md") from None
    folder = path.resolve().parent
    capture = msgspec.structs.replace(config.capture, path=str(folder / config.capture.path))
    estimator = msgspec.structs.replace(
        config.estimator,
        calibration=str(folder / config.estimator.calibration),
        sensor=str(folder / config.estimator.sensor) if config.estimator.sensor else "",
    )
    return msgspec.structs.replace(config, capture=capture, estimator=estimator)
