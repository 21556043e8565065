"""The sensor: dome, markers and camera; pixels to points on the dome and back, in the fingertip frame F.

F has its origin at the common centre of the dome's spheres, +z from the base to the apex, +x to the image's
right and +y to its bottom. The camera lies near ``position_mm`` on -z and looks along +z; its deviations from
that (offset, tilt, focal length) are a :class:`CameraPose` that the calibration fits.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Indices


class Dome(msgspec.Struct, frozen=True):
    """A silicone hemisphere."""

    outer_radius_mm: float
    wall_mm: float


class Ring(msgspec.Struct, frozen=True):
    """A ring of `count` evenly spaced beads at polar angle `theta_deg`, the first at azimuth `phi0_deg`."""

    theta_deg: float
    count: int
    phi0_deg: float = 0.0


class Markers(msgspec.Struct, frozen=True):
    """Beads on a sphere of `radius_mm`; without `rings` the calibration learns the layout.

    count, layout: of a layout to learn, compared with what was learned where they are given.
    """

    radius_mm: float
    diameter_mm: float
    rings: tuple[Ring, ...] = ()
    count: int | msgspec.UnsetType = msgspec.UNSET  # unset: left out of the fingerprint
    layout: Literal["hexagonal", "any"] | msgspec.UnsetType = msgspec.UNSET


class Camera(msgspec.Struct, frozen=True):
    """The nominal camera; `matrix` is fx, fy, cx, cy in pixels, `distortion` OpenCV's coefficients."""

    width: int
    height: int
    matrix: tuple[float, float, float, float]
    position_mm: tuple[float, float, float]
    fps: float = 30.0
    model: Literal["pinhole", "fisheye"] = "pinhole"
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)


class CameraPose(msgspec.Struct, frozen=True):
    """Deviations of a real camera from the nominal one.

    offset_mm: added to the nominal position; rotation_rad: Rodrigues vector of the camera in F;
    focal_scale: multiplies fx and fy.
    """

    offset_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rotation_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    focal_scale: float = 1.0


class Sensor(msgspec.Struct, frozen=True):
    """The content of a press dataset's ``sensor.toml``; other keys are ignored."""

    dome: Dome
    markers: Markers
    camera: Camera

    @property
    def image_size_px(self) -> tuple[int, int]:
        """Width and height of the images."""
        return self.camera.width, self.camera.height

    def fingerprint(self) -> str:
        """Return 16 hex digits that depend on every value of the description except the frame rate."""
        at_any_rate = msgspec.structs.replace(self, camera=msgspec.structs.replace(self.camera, fps=0.0))
        return hashlib.sha256(msgspec.json.encode(at_any_rate)).hexdigest()[:16]


def bead_layout_mm(markers: Markers) -> tuple[Array, Indices]:
    """Return the bead centres on their sphere, (n, 3) in F, and each bead's ring index, (n,)."""
    points, ring_of = [], []
    for index, ring in enumerate(markers.rings):
        phi = np.radians(ring.phi0_deg) + 2 * np.pi * np.arange(ring.count) / ring.count
        theta = np.radians(ring.theta_deg)
        x, y = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi)
        points.append(markers.radius_mm * np.stack([x, y, np.full_like(x, np.cos(theta))], axis=1))
        ring_of.append(np.full(ring.count, index))
    if not points:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.intp)
    return np.concatenate(points), np.concatenate(ring_of).astype(np.intp)


class View:
    """A real camera: projects points of F to pixels, and pixels to a sphere about F's origin."""

    def __init__(self, camera: Camera, pose: CameraPose | None = None) -> None:
        pose = pose or CameraPose()
        fx, fy, cx, cy = camera.matrix
        self._fisheye = camera.model == "fisheye"
        self._nominal_focal_px = np.array([fx, fy])
        self._matrix = np.array(
            [[fx * pose.focal_scale, 0.0, cx], [0.0, fy * pose.focal_scale, cy], [0.0, 0.0, 1.0]]
        )
        self._distortion = np.asarray(camera.distortion, dtype=np.float64)
        rotation, slopes = cv2.Rodrigues(np.asarray(pose.rotation_rad, dtype=np.float64))
        self._rotation = np.asarray(rotation, dtype=np.float64)  # camera axes as columns in F
        self._rotation_slopes = np.asarray(slopes, dtype=np.float64).reshape(3, 3, 3)  # by each rotation_rad
        self.position_mm: Array = np.asarray(camera.position_mm, dtype=np.float64) + pose.offset_mm

    def project(self, points_mm: Array) -> Array:
        """Return the pixels (n, 2) of points (n, 3) in F, mm."""
        return self._project(points_mm)[0]

    def project_with_slopes(self, points_mm: Array) -> tuple[Array, Array]:
        """Return the pixels (n, 2) of points (n, 3), and their derivatives (n, 2, 7).

        By the camera's offset, mm, its Rodrigues vector, rad, and its focal scale, as in CameraPose.
        """
        pixels, slopes = self._project(points_mm)
        focal, place = (slice(0, 2), slice(11, 14)) if self._fisheye else (slice(6, 8), slice(3, 6))
        by_place = slopes[:, place].reshape(-1, 2, 3)  # of the point in the camera's axes
        turned = (points_mm - self.position_mm) @ self._rotation_slopes  # (3, n, 3)
        by_rotation = np.einsum("npj,rnj->npr", by_place, turned)
        by_scale = slopes[:, focal] @ self._nominal_focal_px
        return pixels, np.concatenate(
            [-by_place @ self._rotation.T, by_rotation, by_scale.reshape(-1, 2, 1)], axis=2
        )

    def _project(self, points_mm: Array) -> tuple[Array, Array]:
        """Return the pixels (n, 2) and the derivatives (2 n, k) of cv2.projectPoints."""
        in_camera = np.ascontiguousarray((points_mm - self.position_mm) @ self._rotation).reshape(-1, 1, 3)
        zero = np.zeros(3)
        project = cv2.fisheye.projectPoints if self._fisheye else cv2.projectPoints
        pixels, slopes = project(in_camera, zero, zero, self._matrix, self._distortion)
        return np.asarray(pixels, dtype=np.float64).reshape(-1, 2), np.asarray(slopes, dtype=np.float64)

    def rays(self, pixels: Array) -> Array:
        """Return the unit directions (n, 3) in F of the rays through pixels (n, 2)."""
        if not len(pixels):
            return np.zeros((0, 3))  # OpenCV takes no empty array
        undistort = cv2.fisheye.undistortPoints if self._fisheye else cv2.undistortPoints
        flat = undistort(np.ascontiguousarray(pixels).reshape(-1, 1, 2), self._matrix, self._distortion)
        flat = np.asarray(flat, dtype=np.float64).reshape(-1, 2)
        directions = np.concatenate([flat, np.ones((len(flat), 1))], axis=1) @ self._rotation.T
        return np.asarray(directions / np.linalg.norm(directions, axis=1, keepdims=True))

    def onto_sphere(self, pixels: Array, radius_mm: float) -> Array:
        """Return the points (n, 3) in F where the rays of pixels (n, 2) leave the sphere; NaN for a miss."""
        ray = self.rays(pixels)
        along = -ray @ self.position_mm
        closest2 = float(self.position_mm @ self.position_mm) - along**2
        with np.errstate(invalid="ignore"):
            distance = along + np.sqrt(radius_mm**2 - closest2)
        return np.asarray(self.position_mm + distance[:, None] * ray)
