"""Shading: how brightness falls off across the skin around each bead of the untouched sensor."""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Plane

INNER, OUTER = 0.65, 1.05  # radii of the ring of skin about a bead, in bead diameters
NEIGHBOUR = 0.58  # radius of a bead with its blurred edge, in bead diameters
MIN_PIXELS = 30  # on the ring, for a slope
ROUNDS = 3
OUTLIER_GREY = 6.0  # grey levels from the plane; such a pixel is another bead's, a highlight's or dirt


class Shading(msgspec.Struct, frozen=True):
    """Brightness of the skin about n beads.

    slope (n, 2): growth of the skin's grey from pixel to pixel, over the bead's contrast. unlit: the plane's
    grey without light (appearance.unlit_grey); None where beads differ from skin by colour: they are then
    taken to be unshaded.
    """

    slope: Array
    unlit: float | None


def skin_reach(diameter: Array, spacing: Array) -> Array:
    """Return the radius (n,) about each bead that holds no other one; spacing (n,): to the nearest bead."""
    return np.asarray(np.maximum(spacing - NEIGHBOUR * diameter, 0.55 * diameter))


def skin_slope(dark: Plane, bead_px: Array, diameter_px: Array, spacing_px: Array) -> Array:
    """Return the slope (n, 2) of the skin's grey about each bead at (n, 2), grey levels a pixel.

    A plane is fitted by least squares to a ring about the bead; pixels far from that plane are left out. The
    slope is 0 where beads are too close to each other.
    """
    reach = int(np.ceil(OUTER * diameter_px.max()))
    span = np.arange(-reach, reach + 1)
    step = np.stack(np.meshgrid(span, span), axis=-1).reshape(-1, 2)
    pixel = np.rint(bead_px).astype(np.intp)[:, None] + step
    inside = np.asarray(((pixel >= 0) & (pixel < dark.shape[::-1])).all(axis=2))
    column, row = np.where(inside[..., None], pixel, 0).transpose(2, 0, 1)
    grey = dark[row, column].astype(np.float64)
    offset = pixel - bead_px[:, None]
    radius = np.hypot(offset[..., 0], offset[..., 1])
    outer = np.minimum(OUTER * diameter_px, skin_reach(diameter_px, spacing_px))
    ring = inside & (radius > INNER * diameter_px[:, None]) & (radius < outer[:, None])
    ring &= ring.sum(axis=1, keepdims=True) >= MIN_PIXELS
    design = np.concatenate([np.ones_like(grey)[..., None], offset], axis=2)
    weight = ring.astype(np.float64)
    for _ in range(ROUNDS):
        weighted = design * weight[..., None]
        normal = weighted.transpose(0, 2, 1) @ design + 1e-9 * np.eye(3)
        fitted = np.linalg.solve(normal, weighted.transpose(0, 2, 1) @ grey[..., None])
        weight = (ring & (np.abs(grey - (design @ fitted)[..., 0]) < OUTLIER_GREY)).astype(np.float64)
    return np.asarray(fitted[:, 1:, 0])
