"""The object's pose by an external camera and an ArUco marker on it: the paper's ground truth (Fig. 18).

Pure: a picture and the camera's intrinsics in, the marker's pose in the camera's frame out. The marker's
frame has its origin in the middle, +x to the right and +y up in the upright marker, +z towards the viewer.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from palpate_host.rotation import Array

DICTIONARY = cv2.aruco.DICT_4X4_50


@dataclass(frozen=True, slots=True)
class MarkerPose:
    """rotation (3, 3), position_m (3,): from the marker's frame to the camera's (x right, y down, z ahead).

    reprojection_px: root mean square distance of the found corners from the pose's.
    """

    rotation: Array
    position_m: Array
    reprojection_px: float


class MarkerCamera:
    """Finds one marker of known size."""

    def __init__(self, intrinsics_px: Array, marker_id: int, side_m: float) -> None:
        """intrinsics_px: (3, 3) pinhole matrix; pictures are taken as free of distortion."""
        self._intrinsics_px, self._marker_id = intrinsics_px, marker_id
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), parameters)
        half = side_m / 2.0
        # Clockwise from the upper left, as the detector gives them.
        self._corners_m = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])

    def pose(self, image: npt.NDArray[np.uint8]) -> MarkerPose | None:
        """The marker's pose in a grey picture (h, w); None when it is not found."""
        corners, ids, _ = self._detector.detectMarkers(image)
        if ids is None or self._marker_id not in ids.ravel():
            return None
        seen_px = corners[int(np.flatnonzero(ids.ravel() == self._marker_id)[0])].reshape(4, 2)
        _, turns, places, errors_px = cv2.solvePnPGeneric(
            self._corners_m, seen_px, self._intrinsics_px, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        best = int(np.argmin(errors_px))
        R, _ = cv2.Rodrigues(turns[best])
        position_m = np.asarray(places[best], dtype=np.float64).ravel()
        return MarkerPose(np.asarray(R, dtype=np.float64), position_m, float(np.ravel(errors_px)[best]))
