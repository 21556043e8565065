"""Bead layouts of random sensors: rings, and the hexagonal pins of a TacTip."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.sensor import Ring

# (theta_deg, count) ring by ring; the first three as the press dataset's specification names them.
RINGS: dict[str, tuple[tuple[float, int], ...]] = {
    "1+6+12+18+24+24": ((0, 1), (15, 6), (30, 12), (45, 18), (60, 24), (75, 24)),
    "1+6x14": ((0, 1), *((5.7 * ring, 6) for ring in range(1, 15))),
    "1+7x12": ((0, 1), *((11.4 * ring, 12) for ring in range(1, 8))),
    "4+9+14+18+20": ((9, 4), (25, 9), (41, 14), (57, 18), (73, 20)),
    "1+5+10+15+20+25": ((0, 1), (15, 5), (30, 10), (45, 15), (60, 20), (75, 25)),
    "1+8x13": ((0, 1), *((9.8 * ring, 13) for ring in range(1, 9))),
}
# 1 + 3 s (s + 1) pins in s shells: (s, polar angle between shells in deg).
HEXAGONAL = {
    "tactip-127": (6, 12.0),
    "tactip-331": (10, 7.3),
    "hexagonal-61": (4, 18.0),
    "hexagonal-91": (5, 14.5),
}
DIAMETER_MM = {"1+6x14": 2.0, "1+7x12": 2.0, "1+8x13": 2.0, "tactip-127": 2.4, "tactip-331": 1.6}  # dense
USUAL_DIAMETER_MM = 3.0
NAMES = (*RINGS, *HEXAGONAL)
IN_TURN = ("1+6+12+18+24+24", "1+6x14", "1+7x12", "tactip-127", "tactip-331")  # by a sensor's seed


def rings(name: str, turn_deg: float) -> tuple[Ring, ...]:
    """Return the rings of a layout rotated about the apex; none for a hexagonal layout.

    Neighbouring rings with the same number of beads are staggered by half a spacing.
    """
    layout = RINGS.get(name, ())
    found: list[Ring] = []
    for number, (theta_deg, count) in enumerate(layout):
        staggered = number % 2 and count == layout[-1][1]
        found.append(
            Ring(float(theta_deg), count, round(turn_deg + (180.0 / count if staggered else 0.0), 3))
        )
    return tuple(found)


def hexagonal_directions(shells: int, step_deg: float, turn_deg: float) -> Array:
    """Return unit vectors (1 + 3 s (s + 1), 3) of a flat hexagonal lattice mapped onto the sphere.

    The distance from the middle becomes the polar angle.
    """
    span = np.arange(-shells, shells + 1)
    i, j = (axis.ravel() for axis in np.meshgrid(span, span, indexing="ij"))
    inside = np.abs(i + j) <= shells
    flat = np.stack([i + j / 2, j * np.sqrt(0.75)], axis=1)[inside]
    theta = np.radians(step_deg) * np.linalg.norm(flat, axis=1)
    phi = np.arctan2(flat[:, 1], flat[:, 0]) + np.radians(turn_deg)
    across = np.sin(theta)
    return np.stack([across * np.cos(phi), across * np.sin(phi), np.cos(theta)], axis=1)
