"""The MuJoCo model of a hand from its [geometry] in hand.toml.

Every finger is the same chain of links. With all joints at zero a finger stands straight up from the palm
(z = 0): its base frame has +x towards the hand's axis, +y tangential, +z up. Abduction turns about +x,
flexion about +y, so that a positive flexion closes the hand. The tip's centre is the end of the last link;
frame F of the dome is there, +z along the link to the apex.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import msgspec
import mujoco
import numpy as np

from palpate_edge.common.errors import ConfigError
from palpate_host.config.geometry_config import GeometryConfig

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]


@dataclass(frozen=True, slots=True)
class JointRange:
    """A joint's name and range, from [[fingers]] of hand.toml."""

    name: str
    min_rad: float
    max_rad: float


def hand_spec(
    geometry: GeometryConfig,
    fingers: Sequence[Sequence[JointRange]],
    tip_sites: Sequence[str],
    tip_radius_m: float,
) -> mujoco.MjSpec:
    """Return the hand as a MuJoCo model: a body for each link, a sphere and a site for each tip.

    Raises ConfigError when the numbers of fingers, azimuths and joints do not agree.
    """
    if len(geometry.base_azimuth_deg) != len(fingers):
        raise ConfigError(
            f"geometry.base_azimuth_deg has {len(geometry.base_azimuth_deg)} angles for"
            f" {len(fingers)} fingers: give each finger one"
        )
    spec = mujoco.MjSpec()
    spec.modelname = "hand"
    spec.compiler.degree = False
    spec.option.gravity = (0.0, 0.0, -9.81)
    for number, (azimuth_deg, joints, site) in enumerate(
        zip(geometry.base_azimuth_deg, fingers, tip_sites, strict=True), start=1
    ):
        _add_finger(spec, geometry, number, math.radians(azimuth_deg), joints, site, tip_radius_m)
    return spec


def _add_finger(
    spec: mujoco.MjSpec,
    geometry: GeometryConfig,
    number: int,
    azimuth_rad: float,
    joints: Sequence[JointRange],
    site: str,
    tip_radius_m: float,
) -> None:
    expected = sum(len(link.joints) for link in geometry.links)
    if len(joints) != expected:
        raise ConfigError(
            f"geometry.links has {expected} joints, finger {number} of [[fingers]] has {len(joints)}:"
            " give each joint of the links one entry in fingers.joints"
        )
    half_turn_rad = (azimuth_rad + math.pi) / 2.0  # the base's +x points to the hand's axis
    body = spec.worldbody.add_body(
        name=f"base_{number}",
        pos=geometry.base_circle_m * np.array([math.cos(azimuth_rad), math.sin(azimuth_rad), 0.0]),
        quat=(math.cos(half_turn_rad), 0.0, 0.0, math.sin(half_turn_rad)),
    )
    remaining = iter(joints)
    height_m = 0.0
    for place, link in enumerate(geometry.links, start=1):
        centre_m = link.length_m / 2.0 if link.centre_of_mass_m is None else link.centre_of_mass_m
        body = body.add_body(
            name=f"link_{number}_{place}",
            pos=(0.0, 0.0, height_m),
            explicitinertial=True,
            mass=link.mass_kg,
            ipos=(0.0, 0.0, centre_m),
            inertia=link.inertia_kgm2,
        )
        for axis, joint in zip(link.joints, remaining, strict=False):
            body.add_joint(
                name=joint.name,
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axis.vector,
                limited=True,
                range=(joint.min_rad, joint.max_rad),
            )
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=(0.0, 0.0, 0.0, 0.0, 0.0, link.length_m),
            size=(link.radius_m, 0.0, 0.0),
            contype=0,
            conaffinity=0,
        )
        height_m = link.length_m
    body.add_geom(
        name=f"{site}_dome",
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        pos=(0.0, 0.0, height_m),
        size=(tip_radius_m, 0, 0),
    )
    body.add_site(name=site, pos=(0.0, 0.0, height_m))
