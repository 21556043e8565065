"""A dome whose silicone is not equally stiff everywhere: what this changes in the field of a press.

The field library is of an even wall. Solving every press again would take seconds each; therefore the change
is computed with small displacements: the dome's compliance at the outer surface is condensed once for the
even and once for the uneven wall, and the contact is then solved for a few hundred surface points. The
difference of the two is scaled to the size of the library's field and force. Against full solutions of four
presses with a deviation of 15 %, the force is within 2 % of the even wall's (it changes by 10 to 16 %), and
the change of the field is explained by 36, 91, 98 and 99 %; the 36 % are a plate near the pole, whose field
changes by 3 % only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import splu

from palpate_edge.common.arrays import Array
from palpate_twin.dome.elasticity import Solid
from palpate_twin.dome.friction_contact import NORMAL_PENALTY, TANGENT_PENALTY
from palpate_twin.dome.library import Field
from palpate_twin.dome.mesh import DomeMesh, Resolution, dome_mesh
from palpate_twin.dome.press import directions
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler
from palpate_twin.dome.surface import Surface, outer_surface

RESOLUTION = Resolution(6, 4, 2)
PATCH_RAD = np.radians(35.0)  # around the contact; no probe touches farther away
WAVES = 32  # of a random stiffness
WAVE_LENGTH = 0.6  # on the unit sphere: neighbouring regions of 34 deg differ
SHALLOWEST_MM = 0.5  # a shallower press is changed as this one: fewer points of the surface would touch
MOST_ROUNDS = 12  # of the search for the points in contact

Stiffness = Callable[[Array], Array]  # relative shear modulus (n,) at unit vectors (n, 3) in F


def random_stiffness(deviation: float, seed: int) -> Stiffness:
    """Return a smooth random relative stiffness; deviation: standard deviation of its logarithm."""
    rng = np.random.default_rng([seed, 8])
    waves = rng.standard_normal((3, WAVES)) / WAVE_LENGTH
    phase = rng.uniform(0, 2 * np.pi, WAVES)

    def stiffness(at: Array) -> Array:
        summed = np.cos(at @ waves + phase).sum(axis=1) * np.sqrt(2 / WAVES)
        return np.asarray(np.exp(deviation * summed))

    return stiffness


@dataclass(frozen=True, slots=True)
class WallChange:
    """Change of a press by an uneven wall, both over the even wall's: displacement (q, 3) over the root
    mean square of its field, force (3,) over the size of its force."""

    displacement: Array
    force: Array

    def of(self, even: Field) -> Field:
        """Return the field of the even wall, at the change's points, as the uneven one's."""
        size_mm = np.sqrt((even.displacement_mm**2).sum(axis=1).mean())
        even_force = float(np.linalg.norm(even.force_per_mu_mm2))
        force = even.force_per_mu_mm2 + even_force * self.force
        torsion = even.torsion_per_mu_mm3
        if torsion is not None and even_force > 0:  # of the same stretch of wall as the force
            torsion *= float(np.linalg.norm(force)) / even_force
        return Field(even.displacement_mm + size_mm * self.displacement, force, torsion)


class UnevenWall:
    """The change that an uneven wall makes to any press, at some points of the bead sphere."""

    def __init__(
        self,
        stiffness: Stiffness,
        points_mm: Array,
        outer_radius_mm: float,
        wall_mm: float,
        resolution: Resolution = RESOLUTION,
    ) -> None:
        """points_mm (q, 3): in F, inside the wall. Takes some seconds at the usual resolution."""
        mesh = dome_mesh(outer_radius_mm, wall_mm, resolution)
        centre = mesh.points_mm[mesh.cells].mean(axis=1)
        relative = stiffness(centre / np.linalg.norm(centre, axis=1, keepdims=True))
        sampler = Sampler(mesh, points_mm)
        self._even = _Condensed(mesh, np.ones(len(relative)), sampler)
        self._uneven = _Condensed(mesh, relative, sampler)

    def change(
        self,
        theta_rad: float,
        azimuth_rad: float,
        depth_mm: float,
        shear_mm: tuple[float, float],
        probe: Probe,
    ) -> WallChange:
        """Return the change of one press; arguments as in camera.deformation.ProbePress."""
        cos, sin = np.cos(azimuth_rad), np.sin(azimuth_rad)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        outward, along, across = (turn @ way for way in directions(theta_rad))
        move_mm = shear_mm[0] * along + shear_mm[1] * across - depth_mm * outward
        move_mm = move_mm * max(1.0, SHALLOWEST_MM / depth_mm)
        even_mm, even = self._even.press(outward, move_mm, probe)
        uneven_mm, uneven = self._uneven.press(outward, move_mm, probe)
        size_mm = np.sqrt((even_mm**2).sum(axis=1).mean())
        return WallChange((uneven_mm - even_mm) / size_mm, (uneven - even) / np.linalg.norm(even))


class _Condensed:
    """The compliance of one dome between its outer surface and the sampled points, small displacements."""

    def __init__(self, mesh: DomeMesh, relative: Array, sampler: Sampler) -> None:
        """relative (m,): the elements' stiffness."""
        self._radius_mm = mesh.outer_radius_mm
        self._surface: Surface = outer_surface(mesh)
        fixed = np.zeros((len(mesh.points_mm), 3), dtype=bool)
        fixed[mesh.base] = True
        free = np.flatnonzero(~fixed.ravel())
        stiffness = Solid(mesh.points_mm, mesh.cells, relative=relative).stiffness(
            np.zeros_like(mesh.points_mm)
        )
        factors = splu(
            stiffness[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )
        outside = np.setdiff1d(np.unique(mesh.outer_faces), mesh.base)
        self._unknowns = (3 * outside[:, None] + np.arange(3)).ravel()
        loads = np.zeros((stiffness.shape[0], len(self._unknowns)))
        loads[self._unknowns, np.arange(len(self._unknowns))] = 1.0
        moved = np.zeros_like(loads)
        moved[free] = factors.solve(loads[free])
        self._compliance = moved[self._unknowns]
        by_load = moved.reshape(len(mesh.points_mm), 3, -1)
        self._sampled = np.stack([sampler(by_load[:, :, load]) for load in range(by_load.shape[2])], axis=2)
        self._to_points = self._surface.to_points[:, self._unknowns]

    def press(self, outward: Array, move_mm: Array, probe: Probe) -> tuple[Array, Array]:
        """Return the displacement (q, 3) of the sampled points, and the force (3,) on the dome per mu.

        Points in contact stick to the probe, which moves by move_mm (3,).
        """
        points_mm = self._surface.points_mm
        patch = np.flatnonzero(points_mm @ outward > self._radius_mm * np.cos(PATCH_RAD))
        to_patch = self._to_points[(3 * patch[:, None] + np.arange(3)).ravel()]
        patch_compliance = np.asarray(to_patch @ (to_patch @ self._compliance).T)
        given_mm, depth_mm = self._penetration(points_mm[patch], outward, move_mm, probe)
        spring = np.linalg.inv(
            TANGENT_PENALTY * np.eye(3) + (NORMAL_PENALTY - TANGENT_PENALTY) * np.outer(outward, outward)
        )
        area_mm2 = self._surface.area_mm2[patch]
        touching = depth_mm > 0
        for _ in range(MOST_ROUNDS):
            near = np.flatnonzero(touching)
            rows = (3 * near[:, None] + np.arange(3)).ravel()
            matrix = patch_compliance[np.ix_(rows, rows)] + np.kron(np.diag(1 / area_mm2[near]), spring)
            loads = np.zeros(3 * len(patch))
            loads[rows] = np.linalg.solve(matrix, given_mm[near].ravel())
            left_mm = depth_mm + (patch_compliance @ loads).reshape(-1, 3) @ outward
            before, touching = touching, left_mm > 0
            if (touching == before).all():
                break
        nodal = to_patch.T @ loads
        return self._sampled @ nodal, loads.reshape(-1, 3).sum(axis=0)

    def _penetration(
        self, points_mm: Array, outward: Array, move_mm: Array, probe: Probe
    ) -> tuple[Array, Array]:
        """Return how far points (n, 3) must follow the probe (n, 3), and the part along the normal (n,)."""
        height_mm = points_mm @ outward
        gap_mm = self._radius_mm - height_mm
        if probe.radius_mm is not None:
            across2 = (points_mm**2).sum(axis=1) - height_mm**2
            gap_mm = gap_mm + probe.radius_mm - np.sqrt(np.maximum(0.0, probe.radius_mm**2 - across2))
        depth_mm = -float(move_mm @ outward) - gap_mm
        slide_mm = move_mm - (move_mm @ outward) * outward
        return slide_mm - depth_mm[:, None] * outward, depth_mm
