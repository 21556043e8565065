"""Image check: frames that cannot show the beads are rejected before anything is searched in them."""

from __future__ import annotations

import math

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.estimation.frame_record import FrameRejectedError

MIN_DEVIATION = 2.0  # grey levels, standard deviation over the image; less is a blank frame
GREY = 2  # dimensions of a grey image
BLANK_ROW_STEP = 40  # every 40th row is read for it


class ImageCheck:
    """Checks size and content of one camera's images, and that each differs from the one before."""

    def __init__(self, image_size_px: tuple[int, int], channel: str) -> None:
        """image_size_px: (width, height) of the calibration's images; channel: on which it finds the beads,
        see appearance.CHANNELS."""
        self._size_px = image_size_px
        self._channel = channel
        self._last_image: Image | None = None

    def check_image(self, image: Image) -> None:
        """Raise FrameRejectedError for an image of another size, a grey one of coloured beads, a repeated
        or a blank one."""
        last, self._last_image = self._last_image, image
        width, height = self._size_px
        if image.shape[:2] != (height, width):
            raise FrameRejectedError(
                f"frame is {image.shape[1]}x{image.shape[0]}, the calibration is for {width}x{height}"
            )
        if image.ndim == GREY and self._channel != "grey":
            raise FrameRejectedError(
                f"frame is grey, the calibration finds the beads on {self._channel}: let the camera send "
                "colour, or calibrate with grey pictures"
            )
        if last is not None and _is_same(last, image):
            raise FrameRejectedError("frame is the same as the one before: the camera is frozen")
        if _is_blank(image[::BLANK_ROW_STEP]):
            raise FrameRejectedError("frame is blank")


def _is_blank(rows: Image) -> bool:
    """Return whether the rows (r, width, ...) deviate too little. The variance of all r rows is at least that
    of the middle one over r, which is enough in nearly every frame."""
    middle = len(rows) // 2
    if _deviation(rows[middle : middle + 1]) >= MIN_DEVIATION * math.sqrt(len(rows)):
        return False
    return _deviation(rows) < MIN_DEVIATION


def _deviation(pixels: Image) -> float:
    """Return the largest standard deviation of the pixels' channels."""
    return float(max(cv2.meanStdDev(pixels)[1].ravel().tolist()))


def _is_same(last: Image, image: Image) -> bool:
    """Return whether two images are equal. Camera noise never repeats; most differ in the middle row."""
    middle = len(image) // 2
    if last.shape != image.shape:
        return False
    return last[middle].tobytes() == image[middle].tobytes() and np.array_equal(last, image)
