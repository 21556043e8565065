"""Plan of a jig's holes: rings around the apex, as close as their guides allow. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate_edge.common.errors import ConfigError


@dataclass(frozen=True, slots=True)
class JigSize:
    """Sizes of a jig, in mm.

    housing_mm: diameter of the fingertip's housing. skirt_mm: from the plane of the dome's base down to the
    surface on which fingertip and jig stand. rod_mm: diameter of the rod, whose end is half a ball. fit_mm:
    the holes are wider by this. gap_mm: between dome and cap. wall_mm: thickness of the cap, of the guides
    around the holes and of the skirt. guide_mm: length of the guides above the cap. largest_theta_deg: polar
    angle of the last ring.
    """

    housing_mm: float
    rod_mm: float = 10.0
    fit_mm: float = 0.3
    gap_mm: float = 3.0
    wall_mm: float = 2.4
    guide_mm: float = 16.0
    skirt_mm: float = 12.0
    largest_theta_deg: float = 60.0

    @property
    def hole_mm(self) -> float:
        """Diameter of a hole."""
        return self.rod_mm + self.fit_mm

    @property
    def guide_diameter_mm(self) -> float:
        """Outer diameter of the guide around a hole."""
        return self.hole_mm + 2 * self.wall_mm


@dataclass(frozen=True, slots=True)
class Hole:
    """A hole through which the rod points at the dome's centre; number: from 1, as printed on the plan."""

    number: int
    theta_deg: float
    phi_deg: float

    @property
    def outward(self) -> tuple[float, float, float]:
        """The unit vector from the dome's centre to the hole, in frame F."""
        theta, phi = math.radians(self.theta_deg), math.radians(self.phi_deg)
        return (math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta))


def plan_holes(outer_radius_mm: float, size: JigSize) -> tuple[Hole, ...]:
    """Return one hole at the apex, and rings of evenly spaced holes up to the largest polar angle.

    Neighbouring guides are a wall's thickness apart where they leave the cap. Raises ConfigError when the
    dome is too small for a ring.
    """
    radius_mm = outer_radius_mm + size.gap_mm + size.wall_mm
    spacing_mm = size.guide_diameter_mm + size.wall_mm
    last_rad = math.radians(size.largest_theta_deg)
    rings = int(last_rad / _chord_angle_rad(spacing_mm, radius_mm))
    if rings == 0:
        raise ConfigError(
            f"a rod of {size.rod_mm:g} mm is too thick for a dome of {outer_radius_mm:g} mm: "
            "no two guides fit side by side; give a thinner rod"
        )
    holes = [Hole(1, 0.0, 0.0)]
    for ring in range(1, rings + 1):
        theta_rad = last_rad * ring / rings
        count = int(2 * math.pi / _chord_angle_rad(spacing_mm, radius_mm * math.sin(theta_rad)))
        turn_deg = (
            180 / count if ring % 2 == 0 else 0.0
        )  # the holes of every other ring are between those below
        for place in range(count):
            theta_deg = round(math.degrees(theta_rad), 2)
            holes.append(Hole(len(holes) + 1, theta_deg, round(turn_deg + 360 * place / count, 2)))
    return tuple(holes)


def _chord_angle_rad(chord_mm: float, radius_mm: float) -> float:
    """Return the angle of a chord; half a turn where it is longer than the diameter."""
    return 2 * math.asin(min(1.0, chord_mm / (2 * radius_mm)))
