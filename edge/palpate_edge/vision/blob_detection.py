"""Beads in a first frame: on which channel they stand out, and where they are, to a pixel.

Finding uses the determinant of the Hessian at the beads' scale: large on blobs, zero along edges, so the
dome's rim, light patches and printed lines do not answer. subpixel.py then finds their sub-pixel places.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Image, Plane

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


def plane(image: Image, appearance: Appearance) -> Plane:
    """The image's channel (height, width), signed so that beads are dark: uint8 for grey, else float32."""
    if image.ndim == 2 or appearance.channel == "grey":
        grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(cv2.bitwise_not(grey) if appearance.bright else grey, dtype=np.uint8)
    sign = -1.0 if appearance.bright else 1.0
    weights = np.asarray([CHANNELS[appearance.channel]], dtype=np.float32) * np.float32(sign)
    return np.asarray(cv2.transform(image.astype(np.float32), weights), dtype=np.float32)


def unlit_grey(appearance: Appearance) -> float | None:
    """What the plane of such beads holds where no light falls; None for a difference of colours, which is
    nothing in any light that is white."""
    if "-" in appearance.channel:
        return None
    return 255.0 if appearance.bright and appearance.channel == "grey" else 0.0


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
