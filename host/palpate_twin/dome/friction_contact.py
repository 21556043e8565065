"""Unilateral contact with Coulomb friction at the integration points of the dome's surface (penalty method).

Pressures are in units of the shear modulus mu and per undeformed area, lengths in mm.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.dome.probe import Probe, penetration

NORMAL_PENALTY = 100.0  # 1/mm: penetration below 10 um at pressures up to mu
TANGENT_PENALTY = 20.0  # 1/mm: stiffness of sticking points along the surface
FRICTION = 0.6


@dataclass(frozen=True, slots=True)
class ProbeContact:
    """Contact state of the surface points.

    traction: (q, 3) on the dome, per mu; derivative: (q, 3, 3) of the traction by the point, 1/mm; pressure:
    (q,); anchor_mm: (q, 3) point of the probe, in its coordinates, to which each point sticks after this
    step, NaN without contact.
    """

    traction: Array
    derivative: Array
    pressure: Array
    anchor_mm: Array


def no_anchor(count: int) -> Array:
    """Return the anchors of a dome without contact."""
    return np.full((count, 3), np.nan)


def contact(
    probe: Probe, outward: Array, on_probe_mm: Array, anchor_mm: Array, friction: float
) -> ProbeContact:
    """Return the tractions on points of the dome's surface.

    on_probe_mm: (q, 3) points in the probe's coordinates, whose origin is its point of first touch; outward:
    (3,) the dome's outward normal there; anchor_mm: anchors after the last step. A point that comes into
    contact gets its anchor at the end of the step, so it has no friction within that step.
    """
    depth_mm, normal, normal_by_point = penetration(probe, on_probe_mm, outward)
    touching = depth_mm > 0
    pressure = np.where(touching, NORMAL_PENALTY * depth_mm, 0.0)
    pressure_by_point = np.where(touching[:, None], -NORMAL_PENALTY * normal, 0.0)
    traction = pressure[:, None] * normal
    derivative = (
        normal[:, :, None] * pressure_by_point[:, None, :] + pressure[:, None, None] * normal_by_point
    )

    anchored = touching & np.isfinite(anchor_mm[:, 0])
    stretch = np.where(anchored[:, None], on_probe_mm - anchor_mm, 0.0)
    trial, trial_by_point = _stick(stretch, normal, normal_by_point)
    size = np.linalg.norm(trial, axis=1)
    slips = anchored & (size > friction * pressure)
    slide, slide_by_point = _slip(trial, trial_by_point, friction * pressure, friction * pressure_by_point)
    shear = np.where(slips[:, None], slide, trial)
    shear_by_point = np.where(slips[:, None, None], slide_by_point, trial_by_point)

    # The anchor of a sliding point moves to where the stick traction equals the sliding traction.
    moved = on_probe_mm + np.where(slips[:, None], shear / TANGENT_PENALTY, 0.0)
    kept = np.where((anchored & ~slips)[:, None], anchor_mm, moved)
    return ProbeContact(
        traction + np.where(anchored[:, None], shear, 0.0),
        derivative + np.where(anchored[:, None, None], shear_by_point, 0.0),
        pressure,
        np.where(touching[:, None], kept, np.nan),
    )


def _stick(stretch: Array, normal: Array, normal_by_point: Array) -> tuple[Array, Array]:
    """Return the traction of sticking points, a spring along the tangent plane, and its derivative."""
    tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    traction = -TANGENT_PENALTY * np.einsum("qij,qj->qi", tangent, stretch)
    # The tangent plane turns with a sphere's normal: d(n (n.s)) = n_by_point (n.s) + n (s.n_by_point).
    along = np.einsum("qi,qi->q", normal, stretch)
    turning = np.einsum("qi,qij->qj", stretch, normal_by_point)
    by_point = tangent - along[:, None, None] * normal_by_point - normal[:, :, None] * turning[:, None, :]
    return traction, -TANGENT_PENALTY * by_point


def _slip(trial: Array, trial_by_point: Array, limit: Array, limit_by_point: Array) -> tuple[Array, Array]:
    """Return the traction of sliding points, limited by Coulomb's law, and its derivative."""
    size = np.linalg.norm(trial, axis=1)
    size = np.where(size > 0, size, 1.0)
    direction = trial / size[:, None]
    across = np.eye(3) - direction[:, :, None] * direction[:, None, :]
    turning = (limit / size)[:, None, None] * (across @ trial_by_point)
    return limit[:, None] * direction, direction[:, :, None] * limit_by_point[:, None, :] + turning
