"""The [twin] section of hand.toml: what only the simulation needs to know."""

from __future__ import annotations

from typing import Annotated

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Point = tuple[float, float]


class ObjectConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A prism, its axis along z, its centre of mass at the origin.

    outline_m: the corners counter-clockwise seen from +z. inertia_kgm2: about x, y, z; that of a uniform
    prism by default. position_m: where it is held at first, in the hand's frame.
    """

    outline_m: Annotated[tuple[Point, ...], msgspec.Meta(min_length=3)]
    length_m: Positive
    mass_kg: Positive
    position_m: tuple[float, float, float]
    inertia_kgm2: tuple[Positive, Positive, Positive] | None = None


class TipConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """k, xi and b of Eqs. (7)-(8), which the paper leaves open, and what the engine with friction adds."""

    k_N_m2: Positive = 3e5
    xi_Ns_m: NotNegative = 20.0
    b_Nms: NotNegative = 1e-3
    friction: Positive = 0.5


class TwinConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """start_pose_rad: joint angles of each finger at first. armature_kgm2, joint_friction_Nms_rad: of a
    motor with its gear, on the joint's side."""

    start_pose_rad: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)]
    object: ObjectConfig
    tip: TipConfig = TipConfig()
    armature_kgm2: NotNegative = 0.0
    joint_friction_Nms_rad: NotNegative = 0.0
