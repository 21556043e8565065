"""Rigid probes that press the dome: an infinite plate and spheres."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from palpate_edge.common.arrays import Array


class Probe(IntEnum):
    """Probe of a press dataset; its number is used in the field library's file."""

    PLATE = 0
    SPHERE5 = 1
    SPHERE10 = 2

    @property
    def radius_mm(self) -> float | None:
        """Radius of a sphere, None for the plate."""
        return {Probe.PLATE: None, Probe.SPHERE5: 5.0, Probe.SPHERE10: 10.0}[self]

    @property
    def label(self) -> str:
        """Name in the column `probe` of truth.csv."""
        return self.name.lower()


@dataclass(frozen=True, slots=True)
class ProbePose:
    """Pose of a probe in frame F.

    outward: (3,) the dome's outward normal at the point of first touch; at_mm: (3,) current position of the
    probe's point that touched first; twist_rad: turn of the probe about the inward normal through that point.
    """

    probe: Probe
    outward: Array
    at_mm: Array
    twist_rad: float = 0.0

    @property
    def turn(self) -> Array:
        """Return the matrix (3, 3) that rotates the untwisted probe's coordinates into F."""
        x, y, z = -self.outward
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.asarray(
            np.eye(3) + np.sin(self.twist_rad) * cross + (1 - np.cos(self.twist_rad)) * cross @ cross
        )


def penetration(probe: Probe, from_touch_mm: Array, outward: Array) -> tuple[Array, Array, Array]:
    """Return depth and normal of points relative to the probe's surface.

    from_touch_mm: (q, 3) points relative to the probe's point that touches first; outward: (3,) the dome's
    outward normal there. Returns depth_mm (q,), positive inside the probe; the outward unit normal (q, 3) of
    the probe; and the normal's derivative (q, 3, 3) by the point, 1/mm.
    """
    count = len(from_touch_mm)
    radius_mm = probe.radius_mm
    if radius_mm is None:
        return from_touch_mm @ outward, np.tile(-outward, (count, 1)), np.zeros((count, 3, 3))
    from_centre = from_touch_mm - radius_mm * outward
    distance = np.linalg.norm(from_centre, axis=1)
    normal = from_centre / distance[:, None]
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :]
    return radius_mm - distance, normal, across / distance[:, None, None]
