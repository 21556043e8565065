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
Plane = NDArray[np.float32]

SCALE_OF_DIAMETER = 0.36  # sigma of the blob filter in bead diameters
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
    area (n,) in bead disks (1 is a whole bead), shift_px (n,) of the last iteration."""

    position_px: Array
    contrast: Array
    area: Array
    shift_px: Array


def plane(image: Image, appearance: Appearance) -> Plane:
    """The image's channel as float32 (height, width), its sign such that beads are dark."""
    sign = -1.0 if appearance.bright else 1.0
    if image.ndim == 2 or appearance.channel == "grey":
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(grey, dtype=np.float32) * np.float32(sign)
    weights = np.asarray([CHANNELS[appearance.channel]], dtype=np.float32) * np.float32(sign)
    return np.asarray(cv2.transform(image.astype(np.float32), weights), dtype=np.float32)


def find_blobs(dark: Plane, diameter_px: float) -> Blobs:
    """All dark blobs of about `diameter_px` in a plane, anywhere in the image.

    Strength is the scale-normalised root of the Hessian's determinant, about the blob's depth in grey levels.
    """
    sigma = SCALE_OF_DIAMETER * diameter_px
    smooth = cv2.GaussianBlur(dark, (0, 0), sigma)
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
    """Weighted centroids of many beads at once; made once a layout, called every frame."""

    def __init__(self, diameter_px: Array) -> None:
        self._diameter = np.asarray(diameter_px, dtype=np.float32)
        half = int(np.ceil(0.95 * float(self._diameter.max()))) + 1
        self._half = half
        row, column = np.mgrid[-half : half + 1, -half : half + 1]
        self._row = row.ravel().astype(np.intp)
        self._column = column.ravel().astype(np.intp)

    def refine(self, dark: Plane, start_px: Array, iterations: int = 3) -> Refined:
        """Centroids near `start_px` (n, 2). A start too close to the border gets contrast 0."""
        height, width = dark.shape
        half = self._half
        position = start_px.astype(np.float32)
        inside = (
            (position[:, 0] >= half + 1)
            & (position[:, 0] < width - half - 2)
            & (position[:, 1] >= half + 1)
            & (position[:, 1] < height - half - 2)
        )
        position[~inside] = (width / 2, height / 2)
        contrast = np.zeros(len(position), dtype=np.float32)
        area, step = contrast.copy(), np.zeros_like(position)
        for _ in range(iterations):
            step, contrast, area = self._step(dark, position)
            position += step
        position[~inside] = start_px[~inside]
        contrast[~inside] = 0.0
        return Refined(
            position.astype(np.float64),
            contrast.astype(np.float64),
            area.astype(np.float64),
            np.hypot(step[:, 0], step[:, 1]).astype(np.float64),
        )

    def _step(self, dark: Plane, position: Plane) -> tuple[Plane, Plane, Plane]:
        """One centroid step: (n, 2) move, (n,) contrast, (n,) area."""
        height, width = dark.shape
        half = self._half
        centre = np.round(position)
        centre[:, 0] = np.clip(centre[:, 0], half, width - half - 1)
        centre[:, 1] = np.clip(centre[:, 1], half, height - half - 1)
        base = centre[:, 1].astype(np.intp) * width + centre[:, 0].astype(np.intp)
        window = dark.ravel()[base[:, None] + (self._row * width + self._column)]
        dx = self._column.astype(np.float32) - (position[:, 0] - centre[:, 0])[:, None]
        dy = self._row.astype(np.float32) - (position[:, 1] - centre[:, 1])[:, None]
        radius = np.sqrt(dx * dx + dy * dy) / self._diameter[:, None]
        skin = _mean(window, (radius > 0.68) & (radius < 0.9))
        skin = _mean(window, (radius > 0.68) & (radius < 0.9) & (window >= skin[:, None] - 8))
        core = _mean(window, radius < 0.22)
        depth = skin - core
        safe = np.maximum(depth, 1.0)
        weight = np.clip((skin[:, None] - window) / safe[:, None] - 0.25, 0.0, 0.5)
        weight *= np.clip((0.72 - radius) * 8, 0.0, 1.0)
        total = weight.sum(axis=1)
        norm = np.maximum(total, 1e-3)
        move = np.stack([(weight * dx).sum(axis=1) / norm, (weight * dy).sum(axis=1) / norm], axis=1)
        limit = 0.5 * self._diameter[:, None]
        disk = 0.5 * np.pi / 4 * self._diameter**2
        return np.clip(move, -limit, limit), depth, total / disk


def _mean(window: Plane, mask: NDArray[np.bool_]) -> Plane:
    """Mean of the masked pixels of each row."""
    count = np.maximum(mask.sum(axis=1), 1).astype(np.float32)
    return np.asarray((window * mask).sum(axis=1) / count, dtype=np.float32)
