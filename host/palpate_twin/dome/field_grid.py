"""Grid of the field library: directions, contact angles, depths and slides.

Depths are fractions of the largest depth at the contact angle, and slides are fractions of the depth. All
contact angles therefore have the same grid, although a plate reaches the base earlier at low contacts.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array
from palpate_twin.dome.probe import Probe

BEAD_RADIUS_MM = 26.5
RING_STEP_DEG = 9.0
RINGS = 10  # 0 to 81 deg; the next one, at 90 deg, is the fixed base edge
POINTS_A_RING = 8  # times the ring's index

THETA_DEG = np.arange(0.0, 76.0, 5.0)
DEEPEST_MM = 4.0
BASE_SHARE = 0.8  # of the depth 30 (1 - sin theta) at which an infinite plate reaches the base edge

DEPTH_SHARES = np.array([1 / 16, 1 / 8, 1 / 4, 3 / 8, 1 / 2, 5 / 8, 3 / 4, 1.0])
SHEARED = (2, 4, 7)  # indices of the depths with slides
SHEAR_SHARES = np.array([0.15, 0.4])
# Slides at each of those depths: signs of (towards the base, towards +y). Towards -y is the mirror image.
SHEAR_WAYS = ((1, 0), (-1, 0), (0, 1))
CASES = len(DEPTH_SHARES) + len(SHEARED) * len(SHEAR_WAYS) * len(SHEAR_SHARES)


def ring_directions() -> Array:
    """Return unit vectors (361, 3) in F, ring by ring from the pole, each ring from azimuth 0."""
    rows = [np.array([[0.0, 0.0, 1.0]])]
    for ring in range(1, RINGS):
        theta = np.radians(RING_STEP_DEG * ring)
        phi = 2 * np.pi * np.arange(POINTS_A_RING * ring) / (POINTS_A_RING * ring)
        across = np.sin(theta) * np.stack([np.cos(phi), np.sin(phi)], axis=1)
        rows.append(np.column_stack([across, np.full(len(phi), np.cos(theta))]))
    return np.concatenate(rows)


def mirror_order() -> NDArray[np.intp]:
    """Return for each of :func:`ring_directions` the index (361,) of its mirror image y -> -y."""
    first, order = 1, [0]
    for ring in range(1, RINGS):
        count = POINTS_A_RING * ring
        order += [first + (-point) % count for point in range(count)]
        first += count
    return np.array(order, dtype=np.intp)


def largest_depth_mm(theta_rad: float | Array, probe: Probe, outer_radius_mm: float = 30.0) -> Array:
    """Return the library's largest depth: DEEPEST_MM, smoothly reduced where a plate comes near the base."""
    theta_rad = np.asarray(theta_rad, dtype=np.float64)
    if probe is not Probe.PLATE:
        return np.full_like(theta_rad, DEEPEST_MM)
    to_base_mm = BASE_SHARE * outer_radius_mm * (1 - np.sin(theta_rad))
    return np.asarray((DEEPEST_MM**-4.0 + to_base_mm**-4.0) ** -0.25)


def cases(deepest_mm: float) -> list[tuple[float, tuple[float, float]]]:
    """Return (depth_mm, shear_mm) of the rows of one contact angle: all depths, then the slides."""
    rows: list[tuple[float, tuple[float, float]]] = [
        (float(s * deepest_mm), (0.0, 0.0)) for s in DEPTH_SHARES
    ]
    for depth in SHEARED:
        depth_mm = float(DEPTH_SHARES[depth] * deepest_mm)
        for meridional, azimuthal in SHEAR_WAYS:
            sizes = [float(share * depth_mm) for share in SHEAR_SHARES]
            rows += [(depth_mm, (meridional * size, azimuthal * size)) for size in sizes]
    return rows
