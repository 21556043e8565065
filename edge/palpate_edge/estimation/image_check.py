"""Image check: frames that cannot show the beads are rejected before anything is searched in them."""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.estimation.frame_record import FrameRejectedError
from palpate_edge.kernels.deviation import DeviationKernel

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
        self._last_row = b""
        self._deviation = DeviationKernel()

    def check_image(self, image: Image) -> None:
        """Raise FrameRejectedError for an image of another size, a grey one of coloured beads, a repeated
        or a blank one."""
        last, self._last_image = self._last_image, image
        middle = len(image) // 2
        last_row, self._last_row = self._last_row, image[middle : middle + 1].tobytes()
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
        # Camera noise never repeats: most images differ in the middle row.
        if last is not None and last_row == self._last_row and np.array_equal(last, image):
            raise FrameRejectedError("frame is the same as the one before: the camera is frozen")
        if self._is_blank(image[middle % BLANK_ROW_STEP :: BLANK_ROW_STEP]):
            raise FrameRejectedError("frame is blank")

    def _is_blank(self, rows: Image) -> bool:
        """Return whether the rows (r, width, ...), one of them the middle one, deviate too little.

        Their variance is at least that of the middle one over r, which is enough in nearly every frame.
        """
        channels = 1 if rows.ndim == GREY else rows.shape[2]
        if self._deviation.largest(self._last_row, channels) >= MIN_DEVIATION * math.sqrt(len(rows)):
            return False
        return self._deviation.largest(rows.tobytes(), channels) < MIN_DEVIATION
