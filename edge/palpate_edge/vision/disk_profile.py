"""Disk profile: how much each blob resembles a round disk that stands alone on its skin.

The plane is read along rays from the blob's centre. On each ray the edge is where the grey is half-way
between core and skin. A bead's edge is a circle, and the skin around it is bright on all sides; a letter, a
key, the square of a checkerboard or a maximum of noise lacks one of the two. A light's reflection on a bead
is no edge: behind it the ray is dark again.
"""

from __future__ import annotations

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Mask, Plane

RAYS = 24
RADII = np.arange(0.0, 1.31, 0.1)  # along a ray, in the searched diameter
CORE, SKIN = slice(0, 4), slice(8, 11)  # of the radii: inside of a disk, and around it
INSIDE = 6  # radii up to the rim of a disk of the searched diameter; bright ones there are reflections
SHADED_RAYS = 2  # around a bead that may be dark: a neighbour, a speck
NO_EDGE = 1.4  # radius, in the searched diameter, given to a ray without an edge
EDGE_LEVEL = 0.5  # of the way from core to skin
MAX_OVAL, MIN_ISOLATION, MAX_OFFSET = 0.15, 0.65, 0.25
MIN_FILLED = 0.78  # beads with reflections in hard light have 0.84 and more
FILLED_TO = 0.9  # of the edge's radius
DIAMETER_RANGE = (0.6, 1.5)


class DiskProfile(msgspec.Struct, frozen=True):
    """Shape of n blobs; lengths are relative to the searched diameter.

    contrast (n,): grey levels from core to skin; diameter (n,); oval (n,): deviation of the edge from a
    circle, over its radius; isolation (n,): darkest skin around the blob, 1 is as bright as its median, 0 as
    dark as the core; offset (n,): of the circle's centre from the blob's; filled (n,): share of the area
    inside the edge that is dark.
    """

    contrast: Array
    diameter: Array
    oval: Array
    isolation: Array
    offset: Array
    filled: Array

    def is_disk(self, tolerance: float = 1.0) -> Mask:
        """Return which blobs (n,) are disks; tolerance: of the limits but `MIN_FILLED`, 1 for undisturbed
        pictures."""
        low, high = DIAMETER_RANGE
        return np.asarray(
            (self.oval < tolerance * MAX_OVAL)
            & (self.isolation > MIN_ISOLATION / tolerance)
            & (self.offset < tolerance * MAX_OFFSET)
            & (self.filled > MIN_FILLED)
            & (self.diameter > low / tolerance)
            & (self.diameter < high * tolerance)
        )


def disk_profile(dark: Plane, position_px: Array, diameter_px: float) -> DiskProfile:
    """Read the profiles of blobs at `position_px` (n, 2) that should be `diameter_px` wide."""
    if not len(position_px):
        return DiskProfile(*(np.zeros(0) for _ in range(6)))
    angle = 2 * np.pi * np.arange(RAYS) / RAYS
    grey = _rays(dark, position_px, diameter_px * RADII, angle)
    core = np.median(grey[:, CORE], axis=2).min(axis=1)  # of the darkest circle, beside a reflection
    around = grey[:, SKIN]
    contrast = np.median(around.reshape(len(grey), -1), axis=1) - core
    scale = np.maximum(contrast, 1e-3)
    level = (grey - core[:, None, None]) / scale[:, None, None]
    radius = _edges(level)
    x, y = 2 * (radius * np.cos(angle)).mean(axis=1), 2 * (radius * np.sin(angle)).mean(axis=1)
    centred = radius - x[:, None] * np.cos(angle) - y[:, None] * np.sin(angle)
    mean = centred.mean(axis=1)
    darkest = np.sort(around.min(axis=1), axis=1)[:, SHADED_RAYS]
    return DiskProfile(
        contrast=contrast,
        diameter=2 * mean,
        oval=centred.std(axis=1) / np.maximum(mean, 0.05),
        isolation=(darkest - core) / scale,
        offset=np.hypot(x, y),
        filled=_filled(level, radius),
    )


def _rays(dark: Plane, position_px: Array, radius_px: Array, angle: Array) -> Array:
    """Return the grey (n, radii, rays) on circles about each position."""
    count = len(position_px)
    x = position_px[:, 0, None, None] + radius_px[:, None] * np.cos(angle)
    y = position_px[:, 1, None, None] + radius_px[:, None] * np.sin(angle)
    grey = cv2.remap(
        dark.astype(np.float32),
        x.reshape(count, -1).astype(np.float32),
        y.reshape(count, -1).astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return grey.reshape(count, len(radius_px), len(angle)).astype(np.float64)


def _edges(level: Array) -> Array:
    """Return the radius (n, rays) where the level (n, radii, rays) first exceeds `EDGE_LEVEL` for good."""
    above = level > EDGE_LEVEL
    outward = above[:, :INSIDE]
    outward[:] = np.logical_and.accumulate(outward[:, ::-1], axis=1)[:, ::-1]
    first = above.argmax(axis=1)
    before = np.maximum(first - 1, 0)
    high = np.take_along_axis(level, first[:, None], axis=1)[:, 0]
    low = np.take_along_axis(level, before[:, None], axis=1)[:, 0]
    share = np.clip((EDGE_LEVEL - low) / np.maximum(high - low, 1e-6), 0.0, 1.0)
    radius = RADII[before] + (RADII[first] - RADII[before]) * share
    return np.where(above.any(axis=1), radius, NO_EDGE)


def _filled(level: Array, radius: Array) -> Array:
    """Return the dark share (n,) of the area inside the edge at `radius` (n, rays)."""
    area = np.where(RADII[:, None] < FILLED_TO * radius[:, None], RADII[:, None], 0.0)
    return np.asarray(
        (area * (level < EDGE_LEVEL)).sum(axis=(1, 2)) / np.maximum(area.sum(axis=(1, 2)), 1e-9)
    )
