"""The force on the dome from its vertical part, which the scale weighs.

A scale does not measure the horizontal part. Friction holds the skin to the ball, so the force leans from
the normal, at 60 degrees by a quarter of it: the vertical part alone leaves the normal force open within the
friction cone. A model of the dome closes the gap. It gives each force up to the stiffness of the silicone,
which is the same in all of them; what the scale weighed of all presses determines it.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array

LEAST_SPREAD = 0.02  # relative error of the model's forces at least


def cone_bounds_N(outward: Array, up: Array, weight_N: Array, friction: float) -> tuple[Array, Array]:
    """Return the least and the largest normal force (n,) with which the friction cone allows the weights.

    outward (n, 3): contact normals; up (3,): against gravity. The largest is NaN where the cone reaches the
    horizontal plane, since then the weight sets no limit.
    """
    along = outward @ up
    across = np.sqrt(np.maximum(0.0, 1 - along**2))
    weight_N = np.maximum(weight_N, 0.0)
    rest = along - friction * across
    return weight_N / (along + friction * across), np.where(
        rest > 0, weight_N / np.where(rest > 0, rest, 1), np.nan
    )


def forces_from_weights(
    model_force: Array, up: Array, weight_N: Array, weight_sd_N: Array
) -> tuple[Array, float]:
    """Return the forces (n, 3) on the dome, and the relative error of the model's forces.

    model_force (n, 3): of a dome of any one stiffness; up (3,): against gravity; weight_N (n,): downward
    part of the forces, with standard errors (n,). The force is the most probable one: the model's error is
    taken as a factor and a vector, both as large as the weights show, and the weight's as it was measured.
    """
    down = -(model_force @ up)
    scale = float((weight_N * down).sum() / (down**2).sum())
    off_N = weight_N - scale * down
    size_N = np.maximum(scale * np.linalg.norm(model_force, axis=1), 1e-9)
    both = (scale * down) ** 2 + size_N**2  # the model's factor and vector, as the weight shows them
    spread = max(LEAST_SPREAD, float(np.sqrt((off_N**2).mean() / both.mean())))
    force_N = scale * model_force
    # Covariance of force and weight, and variance of the weight.
    shared = spread**2 * (force_N * (scale * down)[:, None] - size_N[:, None] ** 2 * up)
    variance = spread**2 * both + weight_sd_N**2
    return force_N + shared * (off_N / variance)[:, None], spread


def rotation_between(from_directions: Array, to_directions: Array) -> Array:
    """Return the rotation (3, 3) that turns unit vectors (n, 3) onto others best; far-off pairs count less.

    Kabsch's method, repeated with weights of the residuals (Cauchy's).
    """
    weight = np.ones(len(from_directions))
    turn = np.eye(3)
    for _ in range(10):
        u, _, vt = np.linalg.svd((to_directions * weight[:, None]).T @ from_directions)
        turn = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))]) @ vt
        off = np.linalg.norm(to_directions - from_directions @ turn.T, axis=1)
        weight = 1 / (1 + (off / max(float(np.median(off)), 1e-9) / 2) ** 2)
    return np.asarray(turn)
