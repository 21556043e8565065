"""Choices of a person in ``palpate-edge setup``: a file of answers, a camera or a bus by its name."""

from __future__ import annotations

import tomllib
from pathlib import Path

import msgspec

from palpate_edge.daemon.config import EstimatorConfig, FingertipConfig
from palpate_edge.datasets.images import VIDEO_SUFFIXES
from palpate_edge.setup.finger_file import SetupChoices, finger_toml
from palpate_edge.setup.found import FoundBus, FoundCamera

LOCAL_HUB = "hub"


class SetupAnswers(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """The file of ``--answers``: options by their names."""

    output: str | None = None
    name: str | None = None
    camera: str | None = None
    node: int | None = None
    channel: str | None = None
    i2c_bus: int | None = None
    exposure_us: int | None = None
    sensor: str | None = None
    yes: bool | None = None


def named_camera(path: str) -> FoundCamera:
    """Return the camera of a path: a V4L2 device, a recording (folder or video), or a ring of frames."""
    if path.startswith(("/dev/v4l/", "/dev/video")):
        return FoundCamera("v4l2", path, "as given")
    is_recording = Path(path).is_dir() or Path(path).suffix.lower() in VIDEO_SUFFIXES
    return FoundCamera("recorded" if is_recording else "shared_memory", path, "as given")


def named_bus(channel: str) -> FoundBus:
    """Return the bus of a --channel: the local hub for ``hub``, else a CAN interface."""
    if channel == LOCAL_HUB:
        return FoundBus("palpate", "", "as given")
    return FoundBus("socketcan", channel, "as given")


def trial_config(choices: SetupChoices, sensor: Path | None) -> FingertipConfig:
    """Return a configuration to try the camera with.

    The size of its images is that of the description `sensor`, else the camera's own.
    """
    config = msgspec.convert(tomllib.loads(finger_toml(choices)), FingertipConfig)
    width, height = choices.camera.size_px or (0, 0)
    camera = msgspec.structs.replace(config.capture.camera, width=width, height=height)
    return msgspec.structs.replace(
        config,
        capture=msgspec.structs.replace(config.capture, camera=camera),
        estimator=EstimatorConfig(sensor=str(sensor) if sensor else ""),
    )
