"""Beads of an unknown sensor: which blobs of one image are beads, and how large they are.

The blobs before the widest relative gap in strength are beads. Under uneven light this gap comes too early.
Blobs after it are added when they are similar: round disks, as dark relative to their surroundings, and
spaced like the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Image, Indices, Plane
from palpate_edge.geometry.points import distances
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.blob_detection import Blobs, find_blobs
from palpate_edge.vision.subpixel import Refiner

HEIGHT_OVER_DIAMETER = (
    60,
    50,
    42,
    35,
    30,
    25,
    20,
)  # of the image; tried without a diameter
MIN_BEADS = 6
MAX_CANDIDATES = 500
SIZE_RATIOS = (0.45, 0.55, 0.65, 0.8, 0.95, 1.1, 1.3, 1.5)
DISK_REACH = 0.85  # radius of the pixels compared with a disk, in its diameters
MIN_ROUNDNESS = 0.7
MIN_DEPTH_SHARE = 0.7  # of the median depth of the beads before the gap
MIN_CONTRAST = 20.0  # grey levels
SPACING_RANGE = (0.55, 2.0)  # distance to the nearest bead, in median spacings


@dataclass(frozen=True, slots=True)
class Disks:
    """Similarity of blobs (n,) to dark disks.

    roundness: correlation with the best disk, 1 is perfect; diameter_px: of that disk; contrast: grey levels
    between surroundings and core; depth: contrast over the surroundings' grey, independent of the light.
    """

    roundness: Array
    diameter_px: Array
    contrast: Array
    depth: Array


def beads_without_layout(image: Image, diameter_px: float | None = None) -> tuple[Blobs, Appearance, float]:
    """Return the beads of an unknown layout, their appearance, and their diameter in pixels.

    Dark and bright beads are tried; without `diameter_px`, diameters from 1/60 to 1/20 of the image's height
    as well.
    """
    sizes = [diameter_px] if diameter_px else [image.shape[0] / n for n in HEIGHT_OVER_DIAMETER]
    best: tuple[float, Blobs, Appearance, float] | None = None
    for bright in (False, True):
        appearance = Appearance("grey", bright)
        dark = plane(image, appearance)
        for size in sizes:
            blobs = find_blobs(dark, size)
            score = prominence(blobs)
            if best is None or score > best[0]:
                best = (score, blobs, appearance, size)
    assert best is not None
    _, blobs, appearance, size = best
    return add_similar(plane(image, appearance), blobs, size), appearance, size


def prominence(blobs: Blobs) -> float:
    """Return how clearly some blobs stand out: the widest gap in strength times the strength before it."""
    count, gap = widest_gap(blobs.strength)
    return gap * float(np.median(blobs.strength[:count])) if count else 0.0


def widest_gap(strength: Array) -> tuple[int, float]:
    """Return the number of blobs before the widest relative gap in strength, and its ratio."""
    if len(strength) < MIN_BEADS + 2:
        return 0, 0.0
    ratio = strength[MIN_BEADS - 1 : -1] / np.maximum(strength[MIN_BEADS:], 1e-6)
    place = int(np.argmax(ratio))
    return place + MIN_BEADS, float(ratio[place])


def add_similar(dark: Plane, blobs: Blobs, diameter_px: float) -> Blobs:
    """Return the blobs before the widest gap in strength, and the similar ones after it."""
    count, _ = widest_gap(blobs.strength)
    if not count:
        return Blobs(blobs.position_px[:0], blobs.strength[:0])
    place = blobs.position_px[:MAX_CANDIDATES]
    disks = disk_likeness(dark, place, diameter_px)
    similar = (
        (disks.roundness > MIN_ROUNDNESS)
        & (disks.depth > MIN_DEPTH_SHARE * float(np.median(disks.depth[:count])))
        & (disks.contrast > MIN_CONTRAST)
    )
    kept = _add_spaced(place, count, np.flatnonzero(similar[count:]) + count)
    return Blobs(blobs.position_px[kept], blobs.strength[kept])


def _add_spaced(place: Array, count: int, candidates: Indices) -> Indices:
    """Return the first `count` places and those candidates, strongest first, that are spaced like them."""
    kept = list(range(min(count, len(place))))
    apart = distances(place, place)
    np.fill_diagonal(apart, np.inf)
    spacing = float(np.median(apart[np.ix_(kept, kept)].min(axis=1)))
    waiting = [int(candidate) for candidate in candidates]
    added = True
    while added:
        added = False
        for candidate in waiting:
            nearest = float(apart[candidate, kept].min()) / spacing
            if SPACING_RANGE[0] < nearest < SPACING_RANGE[1]:
                kept.append(candidate)
                added = True
        waiting = [candidate for candidate in waiting if candidate not in kept]
    return np.array(sorted(kept), dtype=np.intp)


def disk_likeness(dark: Plane, place_px: Array, diameter_px: float) -> Disks:
    """Compare the places (n, 2) with dark disks of about `diameter_px`."""
    count = len(place_px)
    best = Disks(np.full(count, -1.0), np.full(count, diameter_px), np.zeros(count), np.zeros(count))
    if not count:
        return best
    refined = Refiner(np.full(count, diameter_px)).refine(dark, place_px)
    moved = np.linalg.norm(refined.position_px - place_px, axis=1)
    centre = np.where((moved < 0.3 * diameter_px)[:, None], refined.position_px, place_px)
    for size in (ratio * diameter_px for ratio in SIZE_RATIOS):
        found = _compare(dark, centre, size)
        better = found.roundness > best.roundness
        for name in ("roundness", "diameter_px", "contrast", "depth"):
            getattr(best, name)[better] = getattr(found, name)[better]
    return best


def _compare(dark: Plane, centre_px: Array, size_px: float) -> Disks:
    """Correlate the pixels about each centre with a disk of one size."""
    reach = int(np.ceil(DISK_REACH * size_px)) + 1
    span = np.arange(-reach, reach + 1)
    row, column = (grid.ravel() for grid in np.meshgrid(span, span, indexing="ij"))
    middle = np.rint(centre_px).astype(np.intp)
    rows = np.clip(middle[:, 1:] + row, 0, dark.shape[0] - 1)
    columns = np.clip(middle[:, :1] + column, 0, dark.shape[1] - 1)
    grey = np.asarray(dark[rows, columns], dtype=np.float64)
    offset = centre_px - middle
    radius = np.hypot(column - offset[:, :1], row - offset[:, 1:])
    inside = (radius < DISK_REACH * size_px).astype(np.float64)
    disk = np.clip(size_px / 2 - radius + 0.5, 0.0, 1.0)
    core = _mean(grey, (radius < max(1.0, 0.25 * size_px)).astype(np.float64))
    skin = _mean(grey, inside * (disk == 0))
    off_grey = (_mean(grey, inside)[:, None] - grey) * inside
    for axis in (column - offset[:, :1], row - offset[:, 1:]):  # subtract a slope of light or background
        across = axis * inside
        slope = (off_grey * across).sum(axis=1) / np.maximum((across**2).sum(axis=1), 1e-9)
        off_grey = off_grey - slope[:, None] * across
    off_disk = (disk - _mean(disk, inside)[:, None]) * inside
    both = np.sqrt((off_grey**2).sum(axis=1) * (off_disk**2).sum(axis=1))
    roundness = (off_grey * off_disk).sum(axis=1) / np.maximum(both, 1e-9)
    depth = (skin - core) / np.maximum(skin, 1.0)
    return Disks(roundness, np.full(len(centre_px), size_px), skin - core, depth)


def _mean(value: Array, weight: Array) -> Array:
    """Return the weighted mean (n,) of each row of values (n, k)."""
    return np.asarray((value * weight).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9))
