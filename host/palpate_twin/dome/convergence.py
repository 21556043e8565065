"""Convergence study: one press on meshes of increasing resolution, and its balance of forces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from palpate_twin.dome import field_grid
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import press
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler

MESHES = (Resolution(4, 3, 1), Resolution(6, 4, 2), Resolution(8, 6, 2), Resolution(12, 8, 2))
SHEAR_SHARE = 0.15


@dataclass(frozen=True, slots=True)
class MeshResult:
    """The press on one mesh.

    force_per_mu_mm2: magnitude of the contact force; imbalance: |contact + base| / |contact|; field_rms_mm:
    difference of the bead sphere's displacement from that on the finest mesh.
    """

    resolution: Resolution
    unknowns: int
    force_per_mu_mm2: float
    imbalance: float
    field_rms_mm: float


def converge(
    theta_rad: float, depth_mm: float, probe: Probe, meshes: tuple[Resolution, ...] = MESHES
) -> Iterator[MeshResult]:
    """Yield the same press with a small slide towards the base on half domes, from the finest mesh on."""
    finest = None
    for resolution in reversed(meshes):
        dome = ElasticDome(dome_mesh(resolution=resolution, half=True))
        pressed = press(dome, theta_rad, depth_mm, probe, (SHEAR_SHARE * depth_mm, 0.0))
        sample = Sampler(dome.mesh, field_grid.BEAD_RADIUS_MM * field_grid.ring_directions())
        field = sample(pressed.displacement_mm)
        finest = field if finest is None else finest
        size = float(np.linalg.norm(pressed.force_per_mu_mm2))
        yield MeshResult(
            resolution,
            unknowns=dome.unknowns,
            force_per_mu_mm2=size,
            imbalance=float(np.linalg.norm(pressed.force_per_mu_mm2 + pressed.base_per_mu_mm2)) / size,
            field_rms_mm=float(np.sqrt(np.mean(np.sum((field - finest) ** 2, axis=1)))),
        )
