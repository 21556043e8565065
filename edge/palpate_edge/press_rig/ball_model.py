"""Force of a ball on the dome by its motion, from finite elements: a ball of a sixth of the dome's radius, a
wall of a sixth, skin that sticks to the ball.

Forces are those of a silicone of shear modulus 1 N/mm^2; how stiff a dome is, the scale shows. The file is
made by ``palpate-host simulate dome ball``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import atomic_file
from palpate_edge.common.errors import CalibrationError
from palpate_edge.geometry.sensor import Dome
from palpate_edge.press_rig.dome_place import tangents

SHIPPED = Path(__file__).with_name("ball_forces.npz")
RADIUS_MM = 30.0  # of the dome of the file
SIXTH, SIXTH_TOLERANCE = 1 / 6, 0.02
SCALES = np.array([0.2, 1.5, 1.0, 1.0])  # of angle (rad), depth (mm) and slide (depths), for a kernel of 1
RIDGE = 1e-5
SLIDE_DEPTH_MM = 1e-6


@dataclass(frozen=True, slots=True)
class BallModel:
    """centres (n, 4) and weights (n, 3) of a kernel expansion, and its offset (3,): force over depth, N/mm,
    by polar angle, depth and slide."""

    centres: Array
    weights: Array
    offset: Array

    def forces(self, motions: Array) -> Array:
        """Return forces (n, 3), N: outward, towards the base and along increasing azimuth.

        motions (n, 4): polar angle, rad; depth, mm; slide towards the base and along azimuth, mm; on a dome
        of `RADIUS_MM`.
        """
        depth_mm = motions[:, 1:2]
        kernels = gaussian_kernel(_points(motions), self.centres, 1.0)
        return np.asarray((kernels @ self.weights + self.offset) * depth_mm)


def fit_ball_model(motions: Array, forces: Array) -> BallModel:
    """Return the model of forces (n, 3) by motions (n, 4), which are taken with their mirror images."""
    mirror = np.array([1.0, 1.0, 1.0, -1.0])
    motions = np.concatenate([motions, motions * mirror])
    target = np.concatenate([forces, forces * mirror[1:]]) / motions[:, 1:2]
    points = _points(motions)
    offset = np.asarray(target.mean(axis=0))
    gram = gaussian_kernel(points, points, 1.0) + RIDGE * np.eye(len(points))
    return BallModel(points, np.linalg.solve(gram, target - offset), offset)


def save_ball_model(model: BallModel, path: Path) -> None:
    """Write a model. Raises CalibrationError when the file system refuses."""
    with atomic_file(path, CalibrationError) as file:
        np.savez_compressed(
            file, allow_pickle=False, centres=model.centres, weights=model.weights, offset=model.offset
        )


def load_ball_model(path: Path = SHIPPED) -> BallModel:
    """Read a model."""
    with np.load(path, allow_pickle=False) as file:
        return BallModel(file["centres"], file["weights"], file["offset"])


def suits(dome: Dome, ball_radius_mm: float) -> bool:
    """Return whether a dome and a ball have the proportions of the model."""
    shares = (dome.wall_mm / dome.outer_radius_mm, ball_radius_mm / dome.outer_radius_mm)
    return all(abs(share - SIXTH) <= SIXTH_TOLERANCE for share in shares)


def ball_forces(model: BallModel, dome: Dome, outwards: Array, depth_mm: Array, slide_mm: Array) -> Array:
    """Return the forces (n, 3) on a dome, times its shear modulus in N/mm^2, in the axes of `outwards`.

    outwards (n, 3): contact normals in axes whose z is about the dome's axis; depth_mm (n,); slide_mm (n, 2)
    towards the base and along increasing azimuth. Motions grow with the dome, forces with its square.
    """
    ratio = dome.outer_radius_mm / RADIUS_MM
    theta = np.arccos(np.clip(outwards[:, 2], -1, 1))
    local = model.forces(np.column_stack([theta, depth_mm / ratio, slide_mm / ratio])) * ratio**2
    axes = np.array([[at, *tangents(at)] for at in outwards])
    return np.asarray((local[:, :, None] * axes).sum(axis=1))


def _points(motions: Array) -> Array:
    """Return motions as points (n, 4) of the kernel: the slide over the depth."""
    over_depth = motions[:, 2:] / np.maximum(motions[:, 1:2], SLIDE_DEPTH_MM)
    return np.asarray(np.column_stack([motions[:, :2], over_depth]) / SCALES)
