"""The [twin] section of hand.toml: what only the simulation needs to know."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec

from palpate_host.config.value_types import NotNegative, Positive

Point = tuple[float, float]
Vector = tuple[float, float, float]


class ObjectConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A prism, its axis along z, its centre of mass at the origin.

    outline_m: the corners counter-clockwise seen from +z. taper_m: length over which each end tapers;
    end_ratio: outline of an end over outline_m. inertia_kgm2: about x, y, z; that of a uniform body by
    default. position_m: where it is held at first, in the hand's frame.
    """

    outline_m: Annotated[tuple[Point, ...], msgspec.Meta(min_length=3)]
    length_m: Positive
    mass_kg: Positive
    position_m: tuple[float, float, float]
    inertia_kgm2: tuple[Positive, Positive, Positive] | None = None
    taper_m: NotNegative = 0.0
    end_ratio: Annotated[float, msgspec.Meta(gt=0, le=1)] = 1.0


class TipConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k, xi and b of Eqs. (7)-(8), which the paper leaves open, and what the engine with friction adds."""

    k_N_m2: Positive = 3e5
    xi_Ns_m: NotNegative = 20.0
    b_Nms: NotNegative = 1e-3
    friction: Positive = 0.5


class DisturbanceConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A load on the grasped object for some time; overlapping loads add up.

    start_s: simulated seconds since the start of the simulation. duration_s: infinite by default. force_N, in
    the hand's frame, acts at the centre of mass together with torque_Nm. added_mass_kg: a point mass at the
    centre of mass, with its weight, also while the object itself is supported. friction: replaces the tips'
    coefficient in the engine with friction; of overlapping ones the last in the list counts.
    """

    start_s: NotNegative = 0.0
    duration_s: Positive = math.inf
    force_N: Vector = (0.0, 0.0, 0.0)
    torque_Nm: Vector = (0.0, 0.0, 0.0)
    added_mass_kg: NotNegative = 0.0
    friction: Positive | None = None


class TwinConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """start_pose_rad: joint angles of each finger at first. armature_kgm2, joint_friction_Nms_rad: of a
    motor with its gear, on the joint's side. disturbances: loads on the object."""

    start_pose_rad: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)]
    object: ObjectConfig
    tip: TipConfig = TipConfig()
    armature_kgm2: NotNegative = 0.0
    joint_friction_Nms_rad: NotNegative = 0.0
    disturbances: tuple[DisturbanceConfig, ...] = ()
