"""The object's pose by an external camera and an ArUco marker on it: the paper's ground truth (Fig. 18).

Pure: a picture and the camera's intrinsics in, the marker's pose in the camera's frame out. The marker's
frame has its origin in the middle, +x to the right and +y up in the upright marker, +z towards the viewer.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation

DICTIONARY = cv2.aruco.DICT_4X4_50
MIN_SIDE_PX = 24.0
"""Shortest accepted side of a marker of 6 x 6 cells: 4 pixels a cell."""
MAX_MISFIT_PX = 1.5
CORNER_NOISE_PX = 0.15
AMBIGUOUS_RATIO = 1.5
AMBIGUOUS_DEG = 5.0
"""A flat marker has two poses that fit. The first is accepted only when the second's misfit exceeds both the
corners' noise (twice that of rendered pictures) and `AMBIGUOUS_RATIO` times the first's."""


@dataclass(frozen=True, slots=True)
class MarkerPose:
    """The pose of a marker in one picture.

    rotation (3, 3), position_m (3,): from the marker's frame to the camera's (x right, y down, z ahead).
    reprojection_px: root mean square distance of the detected corners from the pose's. corners_px: (4, 2).
    """

    rotation: Array
    position_m: Array
    reprojection_px: float
    corners_px: Array


@dataclass(frozen=True, slots=True)
class Refusal:
    """The reason why a picture gives no pose."""

    reason: str


class MarkerCamera:
    """The detector of one marker of known size."""

    def __init__(
        self, intrinsics_px: Array, marker_id: int, side_m: float, distortion: Array | None = None
    ) -> None:
        """Make the detector.

        intrinsics_px: (3, 3) pinhole matrix; distortion: (5,) k1, k2, p1, p2, k3 or None.
        """
        self._intrinsics_px, self._distortion, self._marker_id = intrinsics_px, distortion, marker_id
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        self._detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(DICTIONARY), parameters)
        half = side_m / 2.0
        # Clockwise from the upper left, as the detector gives them.
        self._corners_m = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])

    def pose(self, image: npt.NDArray[np.uint8]) -> MarkerPose | None:
        """Return the result of `measure`, None instead of a refusal."""
        measured = self.measure(image)
        return None if isinstance(measured, Refusal) else measured

    def measure(self, image: npt.NDArray[np.uint8]) -> MarkerPose | Refusal:
        """Return the marker's pose in a grey picture (h, w), or why it has none."""
        corners, ids, _ = self._detector.detectMarkers(image)
        seen = [] if ids is None else [int(number) for number in ids.ravel()]
        if seen.count(self._marker_id) != 1:
            others = f"; the picture has {sorted(seen)}" if seen else ""
            count = "more than once" if self._marker_id in seen else "not found"
            return Refusal(f"marker {self._marker_id} {count}{others}")
        seen_px = np.asarray(corners[seen.index(self._marker_id)], dtype=np.float64).reshape(4, 2)
        side_px = float(np.linalg.norm(seen_px - np.roll(seen_px, 1, axis=0), axis=1).min())
        if side_px < MIN_SIDE_PX:
            return Refusal(f"marker {self._marker_id} too small or too oblique: a side of {side_px:.0f} px")
        return self._solved(seen_px)

    def _solved(self, seen_px: Array) -> MarkerPose | Refusal:
        _, turns, places, errors = cv2.solvePnPGeneric(
            self._corners_m, seen_px, self._intrinsics_px, self._distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        misfits_px = np.ravel(errors)
        order = np.argsort(misfits_px)
        best = int(order[0])
        if misfits_px[best] > MAX_MISFIT_PX:
            return Refusal(
                f"no pose fits the corners better than {misfits_px[best]:.1f} px:"
                " the picture is blurred, or the intrinsics are of another camera"
            )
        R = np.asarray(cv2.Rodrigues(turns[best])[0], dtype=np.float64)
        if len(order) > 1:
            other = np.asarray(cv2.Rodrigues(turns[int(order[1])])[0], dtype=np.float64)
            apart_deg = rotation.angle_deg(other @ R.T)
            plausible_px = max(CORNER_NOISE_PX, AMBIGUOUS_RATIO * misfits_px[best])
            if apart_deg > AMBIGUOUS_DEG and misfits_px[order[1]] < plausible_px:
                return Refusal(
                    f"two poses {apart_deg:.0f} deg apart fit: bring the camera nearer or to the side"
                )
        position_m = np.asarray(places[best], dtype=np.float64).ravel()
        return MarkerPose(R, position_m, float(misfits_px[best]), seen_px)
