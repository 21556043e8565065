"""Camera pose: fit of a CameraPose to beads whose places on the dome are known."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.sensor import Camera, CameraPose, View

# Standard deviations of assembly tolerances; a bead's own place scatters by about a pixel. They keep focal
# length and distance, which one view cannot distinguish, near their nominal values.
PRIOR_SIGMA = np.array([0.5, 0.5, 0.5, 0.02, 0.02, 0.02, 0.02])  # mm, mm, mm, rad, rad, rad, 1
BEAD_SIGMA_PX = 1.0
ITERATIONS = 12


def pose_from(parameters: Array) -> CameraPose:
    """Return the pose of (7,) numbers: offset x, y, z, mm, Rodrigues vector, rad, focal scale minus 1."""
    x, y, z, a, b, c, scale = (float(value) for value in parameters)
    return CameraPose((x, y, z), (a, b, c), 1.0 + scale)


def fit_pose(camera: Camera, layout_mm: Array, pixels: Array) -> CameraPose:
    """Fit the pose that projects `layout_mm` (n, 3) in F onto `pixels` (n, 2), robust to a few wrong pairs.

    Gauss-Newton on Huber-weighted reprojection residuals with the assembly prior.
    """
    parameters = np.zeros(len(PRIOR_SIGMA))
    for _ in range(ITERATIONS):
        projected, slopes = View(camera, pose_from(parameters)).project_with_slopes(layout_mm)
        residual, jacobian = projected - pixels, slopes.reshape(-1, len(parameters))
        size = np.linalg.norm(residual, axis=1)
        huber = np.minimum(1.0, 2.0 * BEAD_SIGMA_PX / np.maximum(size, 1e-9))
        weight = np.repeat(huber, 2) / BEAD_SIGMA_PX**2
        normal = jacobian.T @ (weight[:, None] * jacobian) + np.diag(PRIOR_SIGMA**-2)
        gradient = jacobian.T @ (weight * residual.ravel()) + parameters / PRIOR_SIGMA**2
        step = np.linalg.solve(normal, gradient)
        parameters = parameters - step
        if np.abs(step / PRIOR_SIGMA).max() < 1e-6:
            break
    return pose_from(parameters)
