"""Beads in the image: find them all in a first frame, then refine each in a small window.

Finding uses the determinant of the Hessian at the beads' scale: large on blobs, zero along edges, so the
dome's rim, light patches and printed lines do not answer. Refining is a weighted centroid of the pixels
that differ from the bead's surroundings, for all beads at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Plane = NDArray[np.float32] | NDArray[np.uint8]
Floats = NDArray[np.float32]

SCALE_OF_DIAMETER = 0.36  # sigma of the blob filter in bead diameters
DISK_RADIUS = 0.72  # of the pixels that weigh in the centroid, in bead diameters
LEAST_DISK_RADIUS = 0.55  # where beads stand close
SKIN_RADIUS = 0.8  # of the circle that tells the skin's grey, in bead diameters
SETTLED_STEP = 0.03  # of a bead diameter: a centroid that moved less is on its bead
MOST_STEPS = 4
NOISE_GREY = 8.0  # skin darker than its mean by more is no skin
CHANNELS: dict[str, tuple[float, float, float]] = {  # weights of B, G, R
    "grey": (0.114, 0.587, 0.299),
    "blue": (1.0, 0.0, 0.0),
    "green": (0.0, 1.0, 0.0),
    "red": (0.0, 0.0, 1.0),
    "blue-red": (0.5, 0.0, -0.5),
    "green-red": (0.0, 0.5, -0.5),
    "blue-green": (0.5, -0.5, 0.0),
}


class Appearance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How beads stand out: on which channel, and whether they are brighter than the skin there."""

    channel: str = "grey"
    bright: bool = False


@dataclass(frozen=True, slots=True)
class Blobs:
    """Candidates of one frame, strongest first: position_px (n, 2), strength (n,) in grey levels."""

    position_px: Array
    strength: Array


@dataclass(frozen=True, slots=True)
class Refined:
    """Beads after refinement, in the order given: position_px (n, 2), contrast (n,) in grey levels,
    area (n,) in bead disks (1 is a whole bead), settled (n,): the last step was small."""

    position_px: Array
    contrast: Array
    area: Array
    settled: NDArray[np.bool_]


def plane(image: Image, appearance: Appearance) -> Plane:
    """The image's channel (height, width), signed so that beads are dark: uint8 for grey, else float32."""
    if image.ndim == 2 or appearance.channel == "grey":
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(cv2.bitwise_not(grey) if appearance.bright else grey, dtype=np.uint8)
    sign = -1.0 if appearance.bright else 1.0
    weights = np.asarray([CHANNELS[appearance.channel]], dtype=np.float32) * np.float32(sign)
    return np.asarray(cv2.transform(image.astype(np.float32), weights), dtype=np.float32)


def find_blobs(dark: Plane, diameter_px: float) -> Blobs:
    """All dark blobs of about `diameter_px` in a plane, anywhere in the image.

    Strength is the scale-normalised root of the Hessian's determinant, about the blob's depth in grey levels.
    """
    sigma = SCALE_OF_DIAMETER * diameter_px
    smooth = cv2.GaussianBlur(dark.astype(np.float32), (0, 0), sigma)
    xx = cv2.Sobel(smooth, cv2.CV_32F, 2, 0, ksize=3)
    yy = cv2.Sobel(smooth, cv2.CV_32F, 0, 2, ksize=3)
    xy = cv2.Sobel(smooth, cv2.CV_32F, 1, 1, ksize=3)
    determinant = xx * yy - xy * xy
    determinant[(determinant < 0) | (xx + yy <= 0)] = 0
    response = np.sqrt(determinant) * np.float32(sigma**2 / 4)  # Sobel's second difference weighs 4
    reach = max(1, round(0.6 * diameter_px))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    top = (response >= cv2.dilate(response, kernel)) & (response > 1.0)
    top[[0, -1], :] = False
    top[:, [0, -1]] = False
    rows, columns = np.nonzero(top)
    strength = response[rows, columns].astype(np.float64)
    order = np.argsort(-strength, kind="stable")
    return Blobs(np.stack([columns, rows], axis=1).astype(np.float64)[order], strength[order])


class Refiner:
    """Weighted centroids of many beads at once; made once a layout, called every frame.

    About each bead a few pixels on a circle tell the skin's grey and a few in the middle the bead's; each
    pixel of a disk then weighs by how much nearer it is to the bead's grey, cut off below a quarter
    and above three quarters, so that neither noise nor a highlight on the bead pulls the centroid. The disk
    is larger than the bead: one step is exact unless the bead was far off, and only such beads take another.
    """

    def __init__(self, diameter_px: Array, spacing_px: Array | None = None) -> None:
        """diameter_px (n,) of each bead; spacing_px (n,): distance to the nearest other bead, whose pixels
        are kept out."""
        diameter = np.asarray(diameter_px, dtype=np.float64)
        disk = DISK_RADIUS * diameter
        if spacing_px is not None:
            disk = np.minimum(disk, np.maximum(LEAST_DISK_RADIUS * diameter, spacing_px - 0.5 * diameter))
        largest = float(diameter.max())
        self._margin = int(np.ceil(SKIN_RADIUS * largest)) + 1
        self._reach = int(np.ceil(disk.max()))
        span = np.arange(-self._reach, self._reach + 1)
        row, column = (grid.ravel() for grid in np.meshgrid(span, span, indexing="ij"))
        in_disk = np.hypot(row, column) <= disk[:, None]
        self._in_disk = in_disk.astype(np.float32)
        self._moments = np.stack([np.ones(len(row)), column, row], axis=1).astype(np.float32)
        self._skin = _circle(SKIN_RADIUS * diameter, 16)
        self._core = _circle(0.15 * diameter, 8)
        self._whole_mass = 0.5 * np.pi / 4 * diameter**2
        self._longest_step = 0.5 * diameter[:, None]
        self._settled = SETTLED_STEP * diameter

    def refine(self, dark: Plane, start_px: Array, beads: NDArray[np.intp] | None = None) -> Refined:
        """Centroids near `start_px` (m, 2) of the given `beads` (m,), or of all. A start too close to the
        border gets contrast 0."""
        if beads is None:
            beads = np.arange(len(self._settled))
        height, width = dark.shape
        low = self._margin + 1
        high = np.array([width - self._margin - 2, height - self._margin - 2])
        inside = ((start_px >= low) & (start_px <= high)).all(axis=1)
        position = np.clip(start_px, low, high)
        contrast, area, shift = (np.zeros(len(beads)) for _ in range(3))
        pixels = _Image(dark, self._reach)
        moving = np.arange(len(beads))
        for _ in range(MOST_STEPS):
            which = beads[moving]
            centre = np.rint(np.clip(position[moving], low, high)).astype(np.intp)
            offset, depth, mass = self._centroid(pixels, centre, which)
            longest = self._longest_step[which]
            step = np.clip(centre + offset - position[moving], -longest, longest)
            position[moving] += step
            contrast[moving], area[moving] = depth, mass / self._whole_mass[which]
            shift[moving] = np.sqrt((step**2).sum(axis=1))
            moving = moving[shift[moving] > self._settled[which]]
            if not len(moving):
                break
        contrast[~inside] = 0.0
        position[~inside] = start_px[~inside]
        return Refined(position, contrast, area, shift <= self._settled[beads])

    def _centroid(
        self, pixels: _Image, centre: NDArray[np.intp], beads: NDArray[np.intp]
    ) -> tuple[Floats, Floats, Floats]:
        """Centroid (m, 2) relative to the pixels `centre` (m, 2), contrast (m,), sum of weights (m,)."""
        ring = pixels.at(centre, self._skin[beads])
        bright = ring >= ring.mean(axis=1, keepdims=True) - NOISE_GREY  # not a neighbour's bead
        skin = (ring * bright).sum(axis=1) / bright.sum(axis=1, dtype=np.float32)
        depth = skin - pixels.at(centre, self._core[beads]).mean(axis=1)
        slope = 1.0 / np.maximum(depth, 1.0)
        weight = pixels.squares(centre)
        weight *= -slope[:, None]
        weight += (skin * slope - 0.25)[:, None]
        np.clip(weight, 0.0, 0.5, out=weight)
        weight *= self._in_disk if len(beads) == len(self._in_disk) else self._in_disk[beads]
        mass, x, y = (weight @ self._moments).T
        return np.stack([x, y], axis=1) / np.maximum(mass, 1e-3)[:, None], depth, mass


class _Image:
    """A plane's pixels about many centres at once; `reach` is half the side of its squares."""

    def __init__(self, dark: Plane, reach: int) -> None:
        dark = dark if dark.flags.c_contiguous else dark.copy()
        self._flat, self._width, self._reach = dark.ravel(), dark.shape[1], reach
        side = 2 * reach + 1
        shape = (dark.shape[0] - side + 1, dark.shape[1] - side + 1, side, side)
        self._squares = np.lib.stride_tricks.as_strided(dark, shape, dark.strides * 2, writeable=False)

    def at(self, centre: NDArray[np.intp], offsets: NDArray[np.intp]) -> Floats:
        """Greys (m, k) at `offsets` (m, k, 2) from the pixels `centre` (m, 2); columns come first."""
        place = centre[:, None, :] + offsets
        greys: Plane = self._flat.take(place[..., 1] * self._width + place[..., 0])
        return np.asarray(greys, dtype=np.float32)

    def squares(self, centre: NDArray[np.intp]) -> Floats:
        """Greys (m, side * side) of the squares about the pixels `centre` (m, 2)."""
        corner = centre - self._reach
        squares = self._squares[corner[:, 1], corner[:, 0]]
        return np.asarray(squares.reshape(len(centre), -1), dtype=np.float32)


def _circle(radius: Array, count: int) -> NDArray[np.intp]:
    """Offsets (n, count, 2) of `count` pixels on a circle of each bead's `radius` (n,)."""
    angle = 2 * np.pi * np.arange(count) / count
    offsets = radius[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(np.rint(offsets), dtype=np.intp)
