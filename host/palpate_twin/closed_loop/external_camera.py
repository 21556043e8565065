"""Simulated external camera above the hand, which sees an ArUco marker on the object's upper end.

For a pinhole camera, the image of a flat marker is exactly a homography of its pattern, so no renderer is
needed. Lens blur and sensor noise are added. The marker is never occluded.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_host.common import rotation
from palpate_host.groundtruth.marker import DICTIONARY, MarkerCamera

PATTERN_PX = 6 * 64
QUIET_ZONE_PX = 64
BACKGROUND, NOISE_SIGMA, BLUR_SIGMA_PX = 110, 2.0, 0.7
OVERSAMPLING = 2


@dataclass(frozen=True, slots=True)
class ExternalCamera:
    """Pose of the camera, and size and place of the marker.

    position_m (3,), target_m (3,): position of the camera and the point at which it looks, in the hand frame;
    +y is up in the image. top_m: height of the object's upper end above its centre of mass.
    """

    position_m: Array
    target_m: Array
    top_m: float
    marker_id: int = 7
    side_m: float = 0.030
    width_px: int = 1280
    height_px: int = 720
    focal_px: float = 1400.0

    @property
    def intrinsics_px(self) -> Array:
        """(3, 3) pinhole matrix."""
        return np.array(
            [
                [self.focal_px, 0.0, self.width_px / 2.0 - 0.5],
                [0.0, self.focal_px, self.height_px / 2.0 - 0.5],
                [0.0, 0.0, 1.0],
            ]
        )

    @property
    def rotation(self) -> Array:
        """(3, 3): rows are the camera's axes (right, down, ahead) in the hand frame."""
        ahead = self.target_m - self.position_m
        ahead = ahead / np.linalg.norm(ahead)
        right = rotation.cross(ahead, np.array([0.0, 1.0, 0.0]))
        right = right / np.linalg.norm(right)
        return np.array([right, rotation.cross(ahead, right), ahead])

    def picture(self, object_rotation: Array, object_m: Array, rng: np.random.Generator) -> Image:
        """Return the grey image (height, width) of the marker on an object with the given pose."""
        pattern, metres_of_pattern = self._pattern()
        R = self.rotation @ object_rotation
        origin = self.rotation @ (object_m + object_rotation @ [0.0, 0.0, self.top_m] - self.position_m)
        plane = np.column_stack((R[:, 0], R[:, 1], origin))  # marker (x, y, 1) to the camera
        finer = np.diag([OVERSAMPLING, OVERSAMPLING, 1.0])
        finer[:2, 2] = (OVERSAMPLING - 1) / 2.0  # pixel centres stay where they are
        to_picture = finer @ self.intrinsics_px @ plane @ metres_of_pattern
        size = (OVERSAMPLING * self.width_px, OVERSAMPLING * self.height_px)
        fine = cv2.warpPerspective(
            pattern, to_picture, size, flags=cv2.INTER_LINEAR, borderValue=float(BACKGROUND)
        )
        picture = cv2.resize(fine, (self.width_px, self.height_px), interpolation=cv2.INTER_AREA)
        blurred = cv2.GaussianBlur(picture.astype(np.float32), (0, 0), BLUR_SIGMA_PX)
        noisy = blurred + NOISE_SIGMA * rng.standard_normal(blurred.shape, dtype=np.float32)
        return np.asarray(np.clip(np.rint(noisy), 0, 255), dtype=np.uint8)

    def _pattern(self) -> tuple[Image, Array]:
        """Return the marker with its white margin, and the map (3, 3) from its pixels to metres."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        marker = cv2.aruco.generateImageMarker(dictionary, self.marker_id, PATTERN_PX)
        q = QUIET_ZONE_PX
        pattern = cv2.copyMakeBorder(marker, q, q, q, q, cv2.BORDER_CONSTANT, value=(230.0,))
        step = self.side_m / PATTERN_PX
        middle = (pattern.shape[0] - 1) / 2.0
        metres = np.array([[step, 0.0, -step * middle], [0.0, -step, step * middle], [0.0, 0.0, 1.0]])
        return np.asarray(pattern, dtype=np.uint8), metres


class MarkerTruth:
    """Ground truth of the object's orientation, measured by the marker as in a real experiment."""

    def __init__(self, camera: ExternalCamera) -> None:
        self._camera = camera
        self._detector = MarkerCamera(camera.intrinsics_px, camera.marker_id, camera.side_m)

    def object_rotation(self, image: Image) -> Array | None:
        """Return the orientation (3, 3) in the hand frame, or None if the marker is not found."""
        pose = self._detector.pose(image)
        return None if pose is None else np.asarray(self._camera.rotation.T @ pose.rotation)


def camera_above(object_m: Array, length_m: float) -> ExternalCamera:
    """Return the camera of Fig. 18, 0.35 m above and to the side: the marker's pose is then unambiguous."""
    top = np.array(object_m) + np.array([0.0, 0.0, length_m / 2.0])
    return ExternalCamera(top + np.array([0.10, -0.20, 0.28]), top, length_m / 2.0)
