"""Uncertainty of the virtual object's pose: 95 % radii of place and orientation.

Orientation. Measured normals scatter about the expected ones with a variance v an axis, which the residuals
show. The references are means of `references` normals each, and each correction takes the share s of a
residual, which leaves s/2 of v. n normals have 2 n components for 3 axes:

    sigma^2 = 3/(2 n) (1/references + s/2) v.

Place. It is the integral of the tips' rolling (virtual_object.py): `REST_MM`, mostly from the change of the
tips' indentation, and `WAY_SHARE` of the way from where the hold began, for tips that are not quite spheres.
Each finger's frame that flags slip adds `SLIPPED_MM`, since nothing measures how far the object slid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

AT_REST_RAD = math.radians(0.5)
"""Assumed scatter of a normal before any was measured."""
KEPT_NORMALS = 60.0
"""Number of normals over which their scatter is averaged."""
REST_MM = 0.2
WAY_SHARE = 0.02
SLIPPED_MM = 2.0
RADIUS95_3D = 2.795
"""Radius, over one axis' standard deviation, that holds 95 % of a normal distribution in three dimensions."""


@dataclass(frozen=True, slots=True)
class PoseUncertainty:
    """normal_variance: v in rad^2. slipped_mm: what flagged slip adds to the radius of the place."""

    normal_variance: float = AT_REST_RAD**2
    slipped_mm: float = 0.0

    def after_normal(self, residual_rad: float) -> PoseUncertainty:
        """Return the state after a normal with this angle to the expected one: two components of it."""
        more = (0.5 * residual_rad**2 - self.normal_variance) / KEPT_NORMALS
        return replace(self, normal_variance=self.normal_variance + more)

    def after_slip(self) -> PoseUncertainty:
        """Return the state after a frame that flags slip."""
        return replace(self, slipped_mm=self.slipped_mm + SLIPPED_MM)

    def place95_mm(self, moved_mm: float) -> float:
        """Return the 95 % radius of the place. moved_mm: distance from where the hold began."""
        return REST_MM + WAY_SHARE * moved_mm + self.slipped_mm

    def orientation95_deg(self, fingers: int, references: int, share: float) -> float:
        """Return the 95 % radius of the orientation. share: of one correction."""
        variance = 1.5 / fingers * (1.0 / references + 0.5 * share) * self.normal_variance
        return math.degrees(RADIUS95_3D * math.sqrt(variance))
