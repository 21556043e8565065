"""Parameters of a trial, and the hand that it runs with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import msgspec

from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.twin_config import DisturbanceConfig

UNLIMITED = 1e3
"""friction_ratio of the blind law: this limit is not in the paper and would reduce the blind law's error."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Time in which the contacts of one finger, numbered from 0, are lost; start_s from the turn's start."""

    finger: int
    start_s: float
    duration_s: float

    def contains(self, time_s: float) -> bool:
        """Return whether a frame exposed at this time is lost."""
        return self.start_s <= time_s < self.start_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Trial:
    """Parameters of one run.

    rpy_deg: the commanded rotation. integral_per_s: 0 is the paper's law. noise_mm: standard deviation of the
    contact position along each axis. friction: replaces the tips' coefficient in hand.toml (engine mujoco).
    disturbances: as [[twin.disturbances]] of hand.toml and in its place, but start_s counts from the start of
    the turn. has_weight: the object's support is removed at the start of the turn. law: replaces control.law.
    xyz_mm: the commanded move (pose law only). force_noise: standard deviation of the contact force along
    each axis, relative. sees_slip: the fingertips flag true slip. slip_reflex: replaces pose_law.slip_reflex.
    frame_rate_Hz: exposures of each fingertip. gaps: times in which a finger's contacts are lost.
    """

    mode: ControlMode
    rpy_deg: tuple[float, float, float]
    duration_s: float = 10.0
    delay_s: float = 0.05
    noise_mm: float = 0.0
    integral_per_s: float = 0.0
    seed: int = 1
    friction: float | None = None
    disturbances: tuple[DisturbanceConfig, ...] = ()
    has_weight: bool = False
    law: ControlLaw | None = None
    xyz_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force_noise: float = 0.0
    sees_slip: bool = True
    slip_reflex: bool = True
    frame_rate_Hz: float = 30.0
    gaps: tuple[Gap, ...] = ()


def trial_config(config: HandConfig, trial: Trial) -> HandConfig:
    """Return the hand with the trial's law, target and friction."""
    control = msgspec.structs.replace(config.control, mode=trial.mode, integral_per_s=trial.integral_per_s)
    if trial.law is not None:
        control = msgspec.structs.replace(control, law=trial.law)
    if trial.mode is ControlMode.BLIND:
        control = msgspec.structs.replace(control, friction_ratio=UNLIMITED)
    target = msgspec.structs.replace(config.target, rpy_deg=trial.rpy_deg)
    pose_law = msgspec.structs.replace(config.pose_law, slip_reflex=trial.slip_reflex)
    config = msgspec.structs.replace(config, control=control, target=target, pose_law=pose_law)
    if config.twin is not None and trial.friction is not None:
        tip = msgspec.structs.replace(config.twin.tip, friction=trial.friction)
        config = msgspec.structs.replace(config, twin=msgspec.structs.replace(config.twin, tip=tip))
    return config


def with_disturbances(config: HandConfig, disturbances: tuple[DisturbanceConfig, ...]) -> HandConfig:
    """Return the hand with these disturbances in place of its own; with its own if there are none."""
    if config.twin is None or not disturbances:
        return config
    twin = msgspec.structs.replace(config.twin, disturbances=disturbances)
    return msgspec.structs.replace(config, twin=twin)


def after(disturbances: Sequence[DisturbanceConfig], delay_s: float) -> tuple[DisturbanceConfig, ...]:
    """Return the same disturbances, each later by `delay_s`."""
    return tuple(msgspec.structs.replace(one, start_s=one.start_s + delay_s) for one in disturbances)
