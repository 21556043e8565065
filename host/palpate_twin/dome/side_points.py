"""Table 2 of the paper: distance of two points beside the contact, at contact angles from 90 to 30 deg."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.press import directions, largest_depth_mm, press_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler

TABLE_2 = {90: 1.572, 75: 1.598, 60: 1.596, 45: 1.609, 30: 1.612}  # contact angle in deg: ratio after/before
APART_MM = 8.0  # distance before contact; the paper has 7.7 to 9.3 mm
FORCE_PER_MU_MM2 = 15.0  # at all contact angles: about 2 N with mu = 0.13 N/mm^2
DEPTHS_MM = np.arange(0.5, 4.01, 0.5)


@dataclass(frozen=True, slots=True)
class SidePoints:
    """Distances of two points on the bead sphere's meridian, on both sides of the contact."""

    contact_angle_deg: int
    depth_mm: float
    before_mm: float
    after_mm: float

    @property
    def ratio(self) -> float:
        return self.after_mm / self.before_mm


def side_points(dome: ElasticDome, force_per_mu_mm2: float = FORCE_PER_MU_MM2) -> Iterator[SidePoints]:
    """Yield the distances at each of Table 2's contact angles (90 deg minus theta) under the plate.

    The depth is increased until the force is reached. Raises ConfigError if no depth of DEPTHS_MM reaches it.
    """
    for contact_angle_deg in TABLE_2:
        yield _side_points(dome, contact_angle_deg, force_per_mu_mm2)


def _side_points(dome: ElasticDome, contact_angle_deg: int, force_per_mu_mm2: float) -> SidePoints:
    theta_rad = np.radians(90 - contact_angle_deg)
    half_angle = np.arcsin(APART_MM / 2 / field_grid.BEAD_RADIUS_MM)
    points_mm = field_grid.BEAD_RADIUS_MM * np.stack(
        [_on_meridian(theta_rad - half_angle), _on_meridian(theta_rad + half_angle)]
    )
    sample = Sampler(dome.mesh, points_mm)
    outward, _, _ = directions(theta_rad)
    limit_mm = largest_depth_mm(theta_rad, Probe.PLATE, dome.mesh.outer_radius_mm)
    depths_mm = [float(depth) for depth in DEPTHS_MM if depth <= limit_mm]
    forces, distances = [0.0], [APART_MM]
    for pressed in press_path(dome, theta_rad, [(depth, (0.0, 0.0)) for depth in depths_mm]):
        forces.append(float(-pressed.force_per_mu_mm2 @ outward))
        lower, upper = points_mm + sample(pressed.displacement_mm)
        distances.append(float(np.linalg.norm(upper - lower)))
        if forces[-1] >= force_per_mu_mm2:
            break
    else:
        raise ConfigError(
            f"a force of {force_per_mu_mm2:g} mm^2 mu is not reached: give at most {forces[-1]:.0f}"
        )
    reached = [0.0, *depths_mm][: len(forces)]
    return SidePoints(
        contact_angle_deg,
        depth_mm=float(np.interp(force_per_mu_mm2, forces, reached)),
        before_mm=APART_MM,
        after_mm=float(np.interp(force_per_mu_mm2, forces, distances)),
    )


def _on_meridian(theta_rad: float) -> Array:
    return np.array([np.sin(theta_rad), 0.0, np.cos(theta_rad)])
