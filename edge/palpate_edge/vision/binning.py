"""Binning: images at half the resolution, each pixel the mean of two by two."""

from __future__ import annotations

from typing import cast

import cv2

from palpate_edge.common.arrays import Plane


def halved(image: Plane) -> Plane:
    """Return the image (height, width, ...) at half the resolution; an odd last row or column is left out."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    whole = image[: 2 * height, : 2 * width]
    return cast(Plane, cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))
