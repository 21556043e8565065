"""The definition of an experiment: experiment.toml and the trials that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec

from palpate_edge.common.config_file import Strict, read_toml
from palpate_edge.common.errors import ConfigError
from palpate_host.config.control_config import ControlMode

Text = Annotated[str, msgspec.Meta(min_length=1)]
Word = Annotated[
    str, msgspec.Meta(pattern=r"^[A-Za-z0-9_-]+$", description="one word of letters, digits, - and _")
]  # a folder's name
Positive = Annotated[float, msgspec.Meta(gt=0)]
Seconds = Annotated[float, msgspec.Meta(ge=0.5, le=600)]
Marker = tuple[Annotated[int, msgspec.Meta(ge=0, le=49)], Positive]


class PoseConfig(Strict, frozen=True):
    """A pose of the object in the hand before the grasp.

    offset_mm: from the position in [twin.object] of hand.toml, for the twin. instruction: text for the person
    who places the object in a real hand. turns: names of the turns that start here; all when left out.
    """

    name: Word
    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    instruction: str = msgspec.field(name="say", default="")
    turns: tuple[Word, ...] = ()


class TurnConfig(Strict, frozen=True):
    """A turn about the hand's fixed axes."""

    name: Word
    rpy_deg: tuple[float, float, float]


class ExternalCameraConfig(Strict, frozen=True):
    """The external camera of a real hand: see ``palpate-host groundtruth``.

    device: /dev/v4l/by-path/...; intrinsics: file of ``groundtruth calibrate``, relative to this one; marker,
    base: number and side in mm.
    """

    device: Text
    intrinsics: Text
    marker: Marker
    base: Marker | None = None
    width_px: Annotated[int, msgspec.Meta(ge=160, le=8192)] = 1280
    height_px: Annotated[int, msgspec.Meta(ge=120, le=8192)] = 720
    fps: Positive = 30.0
    exposure_us: Annotated[int, msgspec.Meta(ge=1)] | None = None


class ExperimentConfig(Strict, frozen=True):
    """The contents of experiment.toml.

    hand: ``table3``, ``table4`` or a hand.toml relative to this file. on: the simulated or the real hand.
    seconds: duration of turning, after `settle_s` of grasping. integral_per_s: of the proposed law; 0 in the
    paper. noise_mm, seed: of the twin's contacts. engine: of the twin.
    """

    hand: Text
    on: Literal["twin", "hand"]
    poses: Annotated[tuple[PoseConfig, ...], msgspec.Meta(min_length=1)]
    turns: Annotated[tuple[TurnConfig, ...], msgspec.Meta(min_length=1)]
    laws: Annotated[tuple[ControlMode, ...], msgspec.Meta(min_length=1)] = (
        ControlMode.PROPOSED,
        ControlMode.BLIND,
    )
    seconds: Seconds = 6.0
    settle_s: Seconds = 1.0
    integral_per_s: Annotated[float, msgspec.Meta(ge=0)] = 0.0
    noise_mm: Annotated[float, msgspec.Meta(ge=0)] = 0.15
    seed: Annotated[int, msgspec.Meta(ge=0)] = 1
    engine: Literal["eqs", "mujoco"] = "mujoco"
    camera: ExternalCameraConfig | None = None


@dataclass(frozen=True, slots=True)
class TrialCase:
    """One trial: a turn from a pose by a law."""

    pose: PoseConfig
    turn: TurnConfig
    law: ControlMode

    @property
    def name(self) -> str:
        """The name of the trial's folder."""
        return f"{self.turn.name}-{self.pose.name}-{self.law.value}"


def load(path: Path) -> ExperimentConfig:
    """Read experiment.toml. Raises ConfigError when it is missing or invalid, or its parts contradict."""
    config = read_toml(path, ExperimentConfig, guide="models/experiment.toml in the package shows every key")
    names = [turn.name for turn in config.turns]
    for kind, found in (("turns", names), ("poses", [pose.name for pose in config.poses])):
        for name in found:
            if found.count(name) > 1:
                raise ConfigError(f"{path}: {kind}.name {name!r} is used twice: give each entry its own")
    for pose in config.poses:
        for name in pose.turns:
            if name not in names:
                raise ConfigError(
                    f"{path}: poses.turns of {pose.name}: no turn {name!r}; [[turns]] has {', '.join(names)}"
                )
    if config.on == "hand" and config.camera is None:
        raise ConfigError(f'{path}: on = "hand" needs [camera], which measures how the object turned: add it')
    if config.camera is None:
        return config
    camera = msgspec.structs.replace(config.camera, intrinsics=str(path.parent / config.camera.intrinsics))
    return msgspec.structs.replace(config, camera=camera)


def cases(config: ExperimentConfig) -> list[TrialCase]:
    """Return the trials by turn, pose and law, so that compared trials follow each other."""
    return [
        TrialCase(pose, turn, law)
        for turn in config.turns
        for pose in config.poses
        if not pose.turns or turn.name in pose.turns
        for law in config.laws
    ]
