"""Plain renderer of hand and object without OpenGL: spheres, links and faces, drawn from back to front."""

from __future__ import annotations

import math

import cv2
import mujoco
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_host.common.rotation import cross
from palpate_twin.hand.twin_model import TwinModel

BACKGROUND_RGB = (245, 245, 245)
OUTLINE_RGB = (60, 60, 60)
LIGHT = np.array([0.3, -0.4, 0.87])
FOVY_DEG = 45.0  # MuJoCo's default


def draw_plainly(
    twin: TwinModel, data: mujoco.MjData, camera: mujoco.MjvCamera, size_px: tuple[int, int]
) -> Image:
    """Return an RGB image (height, width, 3) of the model in state `data`, seen by MuJoCo's free camera."""
    height, width = size_px
    image = np.full((height, width, 3), BACKGROUND_RGB, dtype=np.uint8)
    view = _View(camera, size_px)
    # The twin's tip sphere is drawn over the hand model's sphere at the same position.
    shapes = [
        (view.depth(data.geom_xpos[geom]) - (1e-6 if geom in twin.tip_geoms else 0.0), geom)
        for geom in range(twin.model.ngeom)
    ]
    for _, geom in sorted(shapes, reverse=True):
        kind, size = twin.model.geom_type[geom], twin.model.geom_size[geom]
        place, axes = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
        rgb = 255 * twin.model.geom_rgba[geom, :3]
        if kind == mujoco.mjtGeom.mjGEOM_MESH:
            R = data.xmat[twin.object_body].reshape(3, 3)
            faces = [corners @ R.T + data.xpos[twin.object_body] for corners in twin.prism.all_faces_m()]
            _solid(image, view, faces, rgb)
        elif kind == mujoco.mjtGeom.mjGEOM_SPHERE:
            centre, radius = view.pixel(place), round(view.pixels(size[0], place))
            cv2.circle(image, centre, radius, tuple(rgb.tolist()), cv2.FILLED, cv2.LINE_AA)
            cv2.circle(image, centre, radius, OUTLINE_RGB, 1, cv2.LINE_AA)
        else:
            half = axes[:, 2] * size[1 if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 2]
            thick = max(1, round(2 * view.pixels(size[0], place)))
            ends = view.pixel(place - half), view.pixel(place + half)
            cv2.line(image, *ends, tuple((0.8 * rgb).tolist()), thick, cv2.LINE_AA)
    return image


class _View:
    """Pinhole camera with the pose of MuJoCo's free camera."""

    def __init__(self, camera: mujoco.MjvCamera, size_px: tuple[int, int]) -> None:
        azimuth, elevation = math.radians(camera.azimuth), math.radians(camera.elevation)
        ahead = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        right = cross(ahead, np.array([0.0, 0.0, 1.0]))
        right /= np.linalg.norm(right)
        self._axes = np.array([right, cross(ahead, right), ahead])  # right, down, ahead
        self.place = np.array(camera.lookat) - camera.distance * ahead
        self._focal_px = size_px[0] / 2.0 / math.tan(math.radians(FOVY_DEG) / 2.0)
        self._middle = np.array([size_px[1] / 2.0, size_px[0] / 2.0])

    def depth(self, point: Array) -> float:
        return float(self._axes[2] @ (point - self.place))

    def pixels(self, length_m: float, at: Array) -> float:
        return self._focal_px * length_m / self.depth(at)

    def pixel(self, point: Array) -> tuple[int, int]:
        x, y, z = self._axes @ (point - self.place)
        u, v = self._middle + self._focal_px / z * np.array([x, y])
        return round(float(u)), round(float(v))


def _solid(image: Image, view: _View, faces: list[Array], rgb: Array) -> None:
    """Draw the visible faces, corners (k, 3) counter-clockwise from outside."""
    for corners in faces:
        normal = cross(corners[1] - corners[0], corners[2] - corners[1])
        normal /= np.linalg.norm(normal)
        if normal @ (view.place - corners[0]) <= 0.0:
            continue
        shade = 0.55 + 0.45 * abs(float(normal @ LIGHT))
        outline = np.array([view.pixel(corner) for corner in corners], dtype=np.int32)
        cv2.fillConvexPoly(image, outline, tuple((shade * rgb).tolist()), cv2.LINE_AA)
        cv2.polylines(image, [outline], True, OUTLINE_RGB, 1, cv2.LINE_AA)
