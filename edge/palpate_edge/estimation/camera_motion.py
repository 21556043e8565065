"""Camera motion: the displacement of all beads that a moved camera makes, and the dent that remains.

Warming and knocks move the camera against the dome, change its focal length or swell the silicone. All of it
displaces the beads in the image by nearly the same six motions: two shifts, a rotation, a zoom and two tilts.
No press does: at least a quarter of its displacement is a dent that these six cannot make.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array


class SplitMotion(NamedTuple):
    """A displacement (n, 2) as the sum of two: common_px, which a moved camera makes, and dent_px.

    By least squares over the found beads; dent_px is 0 for the others.
    """

    common_px: Array
    dent_px: Array


def camera_modes(position_px: Array) -> Array:
    """Return the displacements (n, 2, 6) by shifts in x and y, rotation, zoom, two tilts; beads at (n, 2)."""
    (x, y), _ = _scaled(position_px)
    one, none = np.ones_like(x), np.zeros_like(x)
    modes = (one, none), (none, one), (-y, x), (x, y), (x * x, x * y), (x * y, y * y)
    return np.stack([np.stack(mode, axis=1) for mode in modes], axis=2)


def camera_slopes(position_px: Array) -> Array:
    """Return the derivatives (2, n, 2, 6) of `camera_modes` by the place along x and along y, 1/px."""
    (x, y), half_width_px = _scaled(position_px)
    one, none = np.ones_like(x), np.zeros_like(x)
    still = none, none
    by_x = still, still, (none, one), (one, none), (2 * x, y), (y, none)
    by_y = still, still, (-one, none), (none, one), (none, x), (x, 2 * y)
    modes = [np.stack([np.stack(mode, axis=1) for mode in by], axis=2) for by in (by_x, by_y)]
    return np.stack(modes) / half_width_px


def _scaled(position_px: Array) -> tuple[Array, float]:
    """Return places (2, n) from their mean in half widths of all, and the half width, px."""
    centred = position_px - position_px.mean(axis=0)
    half_width_px = float(np.abs(centred).max())
    return (centred / half_width_px).T, half_width_px
