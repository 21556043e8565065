"""Solve all presses of the field library and write its file.

The file (.npz):
  directions (d, 3)          unit vectors in F
  theta_rad (n,)             contact's polar angle; its azimuth is 0
  depth_mm (n,)              depth of the probe along the inward normal
  shear_mm (n, 2)            slide of the probe towards the base and towards +y, after the press
  probe (n,)                 number of :class:`Probe`
  displacement_mm (n, d, 3)  float16: displacement of the points BEAD_RADIUS_MM * directions, in F
  force_per_mu_mm2 (n, 3)    on the dome, in F; times the shear modulus in N/mm^2 gives N
  dome (2,)                  outer radius and wall, mm
  resolution (3,)            elements along the cap, down the side, through the wall
  poisson_ratio, friction
Rows have the order of :mod:`field_grid`: by probe, by contact angle, then `cases`. Slides towards -y are the
mirror image of those towards +y and are not stored.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import ConfigError
from palpate_twin.dome import field_grid
from palpate_twin.dome.equilibrium import ElasticDome, State
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import PressedDome, press_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler


@dataclass(frozen=True, slots=True)
class LibraryRow:
    """One press of the library: displacement_mm (d, 3), force_per_mu_mm2 (3,)."""

    theta_rad: float
    depth_mm: float
    shear_mm: tuple[float, float]
    probe: Probe
    displacement_mm: Array
    force_per_mu_mm2: Array


class Domes:
    """A half dome, and a whole one for slides without mirror symmetry, with samplers on the bead sphere."""

    def __init__(
        self, outer_radius_mm: float, wall_mm: float, resolution: Resolution, points_mm: Array
    ) -> None:
        self.half = ElasticDome(dome_mesh(outer_radius_mm, wall_mm, resolution, half=True))
        self.whole = ElasticDome(dome_mesh(outer_radius_mm, wall_mm, resolution))
        self.sample_half = Sampler(self.half.mesh, points_mm)
        self.sample_whole = Sampler(self.whole.mesh, points_mm)
        self._nodes = _mirror_image(self.half.mesh.points_mm, self.whole.mesh.points_mm)
        self._points = _mirror_image(self.half.surface.points_mm, self.whole.surface.points_mm)

    def unfold(self, pressed: PressedDome) -> PressedDome:
        """Return a press of the half dome transferred to the whole one."""
        state = pressed.state
        node, node_sign = self._nodes
        point, point_sign = self._points
        moved = state.displacement_mm[node] * node_sign
        whole = State(moved, state.anchor_mm[point] * point_sign)
        return replace(pressed, displacement_mm=moved, state=whole)


def _mirror_image(half_mm: Array, whole_mm: Array) -> tuple[NDArray[np.intp], Array]:
    """Return for each point of the whole its index in the half, and the sign (1, +-1, 1) that mirrors it."""
    mirrored = whole_mm * np.where(whole_mm[:, 1:2] < 0, [1.0, -1.0, 1.0], 1.0)
    _, number = cKDTree(half_mm).query(mirrored)
    return number, np.where(whole_mm[:, 1:2] < -1e-9, [1.0, -1.0, 1.0], 1.0)


def solve_angle(
    domes: Domes, theta_rad: float, probe: Probe, after_press: Callable[[], None]
) -> list[LibraryRow]:
    """Return all rows of one contact angle in the order of :func:`field_grid.cases`."""
    deepest_mm = float(field_grid.largest_depth_mm(theta_rad, probe, domes.half.mesh.outer_radius_mm))
    rows = field_grid.cases(deepest_mm)
    pressed: list[PressedDome] = []
    fields: list[Array] = []
    depths = len(field_grid.DEPTH_SHARES)
    for found in press_path(domes.half, theta_rad, rows[:depths], probe):
        pressed.append(found)
        fields.append(domes.sample_half(found.displacement_mm))
        after_press()
    sizes = len(field_grid.SHEAR_SHARES)
    for first in range(depths, len(rows), sizes):
        stops = rows[first : first + sizes]
        before = pressed[[row[0] for row in rows[:depths]].index(stops[0][0])]
        sideways = stops[0][1][1] != 0
        dome, sample = (domes.whole, domes.sample_whole) if sideways else (domes.half, domes.sample_half)
        start = domes.unfold(before) if sideways else before
        for found in press_path(dome, theta_rad, stops, probe, start):
            pressed.append(found)
            fields.append(sample(found.displacement_mm))
            after_press()
    return [
        LibraryRow(theta_rad, depth, shear, probe, field, found.force_per_mu_mm2)
        for (depth, shear), field, found in zip(rows, fields, pressed, strict=True)
    ]


def write_library(path: Path, rows: list[LibraryRow], domes: Domes, resolution: Resolution) -> None:
    """Write all rows in order (see the module); an existing file is replaced.

    Raises ConfigError if the folder is not writable.
    """
    mesh = domes.half.mesh
    with atomic_file(path, ConfigError) as file:
        np.savez_compressed(
            file,
            directions=field_grid.ring_directions().astype(np.float32),
            theta_rad=np.array([row.theta_rad for row in rows], dtype=np.float32),
            depth_mm=np.array([row.depth_mm for row in rows], dtype=np.float32),
            shear_mm=np.array([row.shear_mm for row in rows], dtype=np.float32),
            probe=np.array([row.probe for row in rows], dtype=np.uint8),
            displacement_mm=np.array([row.displacement_mm for row in rows], dtype=np.float16),
            force_per_mu_mm2=np.array([row.force_per_mu_mm2 for row in rows], dtype=np.float32),
            dome=np.array([mesh.outer_radius_mm, mesh.wall_mm], dtype=np.float32),
            resolution=np.array([resolution.cap, resolution.side, resolution.wall], dtype=np.uint8),
            poisson_ratio=np.float32(domes.half.poisson_ratio),
            friction=np.float32(domes.half.friction),
        )
