"""Random motions of the ball on the library's dome with their forces, from which the press rig's ball model
is made."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_twin.dome.field_grid import DEEPEST_MM, SHEAR_SHARES, THETA_DEG
from palpate_twin.dome.library import FieldLibrary
from palpate_twin.dome.probe import Probe

LEAST_DEPTH_MM = 0.05


def ball_samples(library: FieldLibrary, count: int, seed: int) -> tuple[Array, Array]:
    """Return motions (count, 4), and forces (count, 3) over the shear modulus, for `fit_ball_model`."""
    rng = np.random.default_rng([seed, 14])
    theta = np.radians(THETA_DEG[-1]) * rng.uniform(0, 1, count)
    depth_mm = rng.uniform(LEAST_DEPTH_MM, DEEPEST_MM, count)
    size_mm = SHEAR_SHARES[-1] * np.sqrt(rng.uniform(0, 1, count)) * depth_mm
    turn = rng.uniform(0, 2 * np.pi, count)
    slide_mm = size_mm[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    forces = np.empty((count, 3))
    for number in range(count):
        along, across = slide_mm[number].tolist()
        x, y, z = library.solved_force_per_mu_mm2(
            float(theta[number]), float(depth_mm[number]), (along, across), Probe.SPHERE5
        )
        sin, cos = np.sin(theta[number]), np.cos(theta[number])
        forces[number] = x * sin + z * cos, x * cos - z * sin, y
    return np.column_stack([theta, depth_mm, slide_mm]), forces
