"""Unilateral contact with Coulomb friction at the integration points of the dome's surface, by penalty.

Per unit shear modulus mu: pressures in units of mu, lengths in mm, per undeformed area.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.dome.probe import Probe, penetration

NORMAL_PENALTY = 100.0  # 1/mm: at the usual pressures, below mu, the probe sinks in by less than 10 um
TANGENT_PENALTY = 20.0  # 1/mm: the same for the creep of a sticking point
FRICTION = 0.6


@dataclass(frozen=True, slots=True)
class ProbeContact:
    """Tractions (q, 3) on the dome, per mu; their derivative (q, 3, 3) by the point, 1/mm; pressure (q,);
    anchor_mm (q, 3): the point of the probe, in its own coordinates, that each point of the dome holds on to
    after this step; nan where nothing touches.
    """

    traction: Array
    derivative: Array
    pressure: Array
    anchor_mm: Array


def no_anchor(count: int) -> Array:
    """Anchors of a dome that nothing has touched yet."""
    return np.full((count, 3), np.nan)


def contact(
    probe: Probe, outward: Array, on_probe_mm: Array, anchor_mm: Array, friction: float
) -> ProbeContact:
    """Tractions on points of the dome's surface.

    on_probe_mm: (q, 3) points in the probe's coordinates, whose origin is its point of first touch; outward:
    (3,) the dome's outward normal there; anchor_mm: as the last step left it. A point that touches for the
    first time takes hold at the end of its step, so it feels no friction within it.
    """
    depth_mm, normal, normal_by_point = penetration(probe, on_probe_mm, outward)
    touching = depth_mm > 0
    pressure = np.where(touching, NORMAL_PENALTY * depth_mm, 0.0)
    pressure_by_point = np.where(touching[:, None], -NORMAL_PENALTY * normal, 0.0)
    traction = pressure[:, None] * normal
    derivative = (
        normal[:, :, None] * pressure_by_point[:, None, :] + pressure[:, None, None] * normal_by_point
    )

    held = touching & np.isfinite(anchor_mm[:, 0])
    stretch = np.where(held[:, None], on_probe_mm - anchor_mm, 0.0)
    trial, trial_by_point = _stick(stretch, normal, normal_by_point)
    size = np.linalg.norm(trial, axis=1)
    slips = held & (size > friction * pressure)
    slide, slide_by_point = _slip(trial, trial_by_point, friction * pressure, friction * pressure_by_point)
    shear = np.where(slips[:, None], slide, trial)
    shear_by_point = np.where(slips[:, None, None], slide_by_point, trial_by_point)

    # What has slipped holds on a little further: where the sliding traction is just the stick traction.
    moved = on_probe_mm + np.where(slips[:, None], shear / TANGENT_PENALTY, 0.0)
    kept = np.where((held & ~slips)[:, None], anchor_mm, moved)
    return ProbeContact(
        traction + np.where(held[:, None], shear, 0.0),
        derivative + np.where(held[:, None, None], shear_by_point, 0.0),
        pressure,
        np.where(touching[:, None], kept, np.nan),
    )


def _stick(stretch: Array, normal: Array, normal_by_point: Array) -> tuple[Array, Array]:
    """Traction of points that hold on, and its derivative: a spring along the tangent plane."""
    tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    traction = -TANGENT_PENALTY * np.einsum("qij,qj->qi", tangent, stretch)
    # The tangent plane turns with a sphere's normal: d(n (n.s)) = n_by_point (n.s) + n (s.n_by_point).
    along = np.einsum("qi,qi->q", normal, stretch)
    turning = np.einsum("qi,qij->qj", stretch, normal_by_point)
    by_point = tangent - along[:, None, None] * normal_by_point - normal[:, :, None] * turning[:, None, :]
    return traction, -TANGENT_PENALTY * by_point


def _slip(trial: Array, trial_by_point: Array, limit: Array, limit_by_point: Array) -> tuple[Array, Array]:
    """Traction of points that slide, and its derivative: the stick traction cut down to Coulomb's limit."""
    size = np.linalg.norm(trial, axis=1)
    size = np.where(size > 0, size, 1.0)
    way = trial / size[:, None]
    across = np.eye(3) - way[:, :, None] * way[:, None, :]
    turning = (limit / size)[:, None, None] * (across @ trial_by_point)
    return limit[:, None] * way, way[:, :, None] * limit_by_point[:, None, :] + turning
