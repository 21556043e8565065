"""The beads of a fingertip's pictures, found as the fingertip finds them, as Rerun entities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from palpate_edge import load_calibration
from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.vision.tracker import Tracker

BEAD_COLOUR = (60, 220, 60)
MOTION_COLOUR = (255, 200, 0)
RADIUS_UI = 2.0
"""Radius of a bead on the screen, at any zoom."""

Drawing = rr.Points2D | rr.Arrows2D


class CameraBeads:
    """The tracker of one camera."""

    def __init__(self, calibration_path: Path) -> None:
        """Read the calibration of the fingertip. Raises CalibrationError when it cannot be read."""
        self._path, calibration = calibration_path, load_calibration(calibration_path)
        self._appearance, self._size_px = calibration.appearance, calibration.sensor.image_size_px
        self._untouched_px = calibration.reference().position_px
        self._tracker = Tracker(calibration.reference())

    def find(self, image: Image) -> tuple[Array, Array]:
        """Return places (n, 2) of the beads that are found in the next picture, and where they are untouched.

        Raises ConfigError for a picture of another size than the calibration's.
        """
        height, width = image.shape[:2]
        if (width, height) != self._size_px:
            raise ConfigError(
                f"{self._path} is of pictures of {self._size_px[0]}x{self._size_px[1]}, the camera's are"
                f" {width}x{height}: give the calibration of this camera"
            )
        beads = self._tracker.follow_image(image, self._appearance)
        return beads.position_px[beads.found], self._untouched_px[beads.found]

    def draw(self, image: Image) -> dict[str, Drawing]:
        """Return the entities below the camera's: beads, and arrows from where they are untouched."""
        found_px, untouched_px = self.find(image)
        # Rerun's pixel (0, 0) has its centre at (0.5, 0.5), OpenCV's at the origin.
        points = rr.Points2D(found_px + 0.5, radii=rr.Radius.ui_points(RADIUS_UI), colors=[BEAD_COLOUR])
        arrows = rr.Arrows2D(
            origins=untouched_px + 0.5, vectors=np.asarray(found_px - untouched_px), colors=[MOTION_COLOUR]
        )
        return {"beads": points, "motion": arrows}
