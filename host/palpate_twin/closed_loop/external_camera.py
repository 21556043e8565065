"""A simulated external camera over the hand: an ArUco marker on the object's upper end, seen by a pinhole.

The picture of a flat marker is a homography of its pattern, exactly; so no renderer is needed. Nothing hides
the marker. What a real camera adds: blur of the lens, noise of the sensor.
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
    """Where camera and marker are.

    position_m (3,), target_m (3,): the camera looks from one at the other, in the hand's frame, its picture
    upright for +y. top_m: height of the object's upper end over its centre of mass.
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
        """(3, 3): rows are the camera's axes (right, down, ahead) in the hand's frame."""
        ahead = self.target_m - self.position_m
        ahead = ahead / np.linalg.norm(ahead)
        right = rotation.cross(ahead, np.array([0.0, 1.0, 0.0]))
        right = right / np.linalg.norm(right)
        return np.array([right, rotation.cross(ahead, right), ahead])

    def picture(self, object_rotation: Array, object_m: Array, rng: np.random.Generator) -> Image:
        """(height, width) grey picture of the marker on an object of that pose."""
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
        """The marker with its white margin, and (3, 3) from its pixels to metres in the marker's frame."""
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        marker = cv2.aruco.generateImageMarker(dictionary, self.marker_id, PATTERN_PX)
        q = QUIET_ZONE_PX
        pattern = cv2.copyMakeBorder(marker, q, q, q, q, cv2.BORDER_CONSTANT, value=(230.0,))
        step = self.side_m / PATTERN_PX
        middle = (pattern.shape[0] - 1) / 2.0
        metres = np.array([[step, 0.0, -step * middle], [0.0, -step, step * middle], [0.0, 0.0, 1.0]])
        return np.asarray(pattern, dtype=np.uint8), metres


class MarkerTruth:
    """The object's pose as the marker tells it: what an experiment without a simulator would know."""

    def __init__(self, camera: ExternalCamera) -> None:
        self._camera = camera
        self._detector = MarkerCamera(camera.intrinsics_px, camera.marker_id, camera.side_m)

    def object_rotation(self, image: Image) -> Array | None:
        """(3, 3) in the hand's frame; None when the marker is not found."""
        pose = self._detector.pose(image)
        return None if pose is None else np.asarray(self._camera.rotation.T @ pose.rotation)


def camera_above(object_m: Array, length_m: float) -> ExternalCamera:
    """The camera of Fig. 18: 0.35 m above and to the side, so that the flat marker's pose is unambiguous."""
    top = np.array(object_m) + np.array([0.0, 0.0, length_m / 2.0])
    return ExternalCamera(top + np.array([0.10, -0.20, 0.28]), top, length_m / 2.0)
