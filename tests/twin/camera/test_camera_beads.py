"""Projection and drawing of beads, compared with OpenCV's projection of their surface and with geometry."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.common.arrays import Array
from palpate_edge.geometry.sensor import Camera, CameraPose
from palpate_twin.camera.bead_ellipse import BeadProjector
from palpate_twin.camera.bead_layer import WHOLE, BeadLayer

CAMERAS = {
    "pinhole": Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0)),
    "bent pinhole": Camera(
        640, 480, (390.0, 385.0, 322.0, 238.0), (0.0, 0.0, -50.0), distortion=(-0.08, 0.0, 0.001, 0.0)
    ),
    "fisheye": Camera(
        640,
        480,
        (230.0, 230.0, 318.0, 243.0),
        (0.0, 0.0, -20.0),
        model="fisheye",
        distortion=(0.02, -0.01, 0.0, 0.0),
    ),
}
POSE = CameraPose((0.8, -0.5, 0.6), (0.03, -0.02, 0.01), 1.02)


def _project(camera: Camera, pose: CameraPose, points_mm: Array) -> Array:
    """Project points of frame F to pixels with OpenCV only."""
    rotation = cv2.Rodrigues(np.array(pose.rotation_rad))[0].T  # F to the camera's axes
    vector = cv2.Rodrigues(rotation)[0]
    shift = -rotation @ (np.array(camera.position_mm) + pose.offset_mm)
    fx, fy, cx, cy = camera.matrix
    matrix = np.array([[fx * pose.focal_scale, 0, cx], [0, fy * pose.focal_scale, cy], [0, 0, 1]])
    project = cv2.fisheye.projectPoints if camera.model == "fisheye" else cv2.projectPoints
    found, _ = project(points_mm.reshape(-1, 1, 3), vector, shift, matrix, np.array(camera.distortion))
    return found.reshape(-1, 2)


def _bead_surface(centre: Array, normal: Array, across: float, flatness: float) -> Array:
    """Return 40,000 points on the surface of a flattened ball."""
    rng = np.random.default_rng(3)
    ball = rng.standard_normal((40_000, 3))
    ball *= across / np.linalg.norm(ball, axis=1, keepdims=True)
    return centre + ball + (flatness - 1) * (ball @ normal)[:, None] * normal


def _outwards(theta_deg: float) -> Array:
    theta, phi = np.radians(theta_deg), 0.7
    return np.array([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)])


def _polygon(corner_px: Array) -> tuple[float, Array, Array]:
    """Return area, centroid (2,) and central second moments (2, 2) of a polygon (n, 2), by OpenCV."""
    about = corner_px.mean(axis=0)  # OpenCV computes in float32
    moments = cv2.moments((corner_px - about).astype(np.float32)[:, None])
    area = moments["m00"]
    second = np.array([[moments["mu20"], moments["mu11"]], [moments["mu11"], moments["mu02"]]]) / area
    return area, about + np.array([moments["m10"], moments["m01"]]) / area, second


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("theta_deg", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("flatness", [1.0, 0.5])
def test_outline_is_the_hull_of_the_projected_surface(name: str, theta_deg: float, flatness: float) -> None:
    normal = _outwards(theta_deg)
    centre = 26.5 * normal
    camera = CAMERAS[name]
    surface_px = _project(camera, POSE, _bead_surface(centre, normal, 1.5, flatness))
    area, middle, second = _polygon(cv2.convexHull(surface_px.astype(np.float32))[:, 0])

    centre_px, shape = BeadProjector(camera, POSE).outlines(
        centre[None], normal[None], np.array([1.5]), flatness
    )

    assert np.pi * np.sqrt(np.linalg.det(shape[0])) == pytest.approx(area, rel=0.015)
    # An even ellipse's second central moment is a quarter of its shape matrix.
    assert shape[0] / 4 == pytest.approx(second, abs=0.02 * second.max())
    assert np.linalg.norm(centre_px[0] - middle) < 0.02


@pytest.mark.parametrize("name", CAMERAS)
@pytest.mark.parametrize("theta_deg", [0.0, 40.0, 75.0])
def test_a_balls_outline_is_its_contour_seen_by_the_camera(name: str, theta_deg: float) -> None:
    normal, radius = _outwards(theta_deg), 1.5
    camera = CAMERAS[name]
    eye = np.array(camera.position_mm) + POSE.offset_mm
    ray = 26.5 * normal - eye
    share = 1 - radius**2 / (ray @ ray)  # tangents touch on a circle about eye + share ray
    _, _, across = np.linalg.svd(ray[None])
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) @ across[1:]
    contour = eye + share * ray + radius * np.sqrt(share) * circle
    _, middle, second = _polygon(_project(camera, POSE, contour))

    centre_px, shape = BeadProjector(camera, POSE).outlines(
        26.5 * normal[None], normal[None], np.array([radius]), 1.0
    )

    assert centre_px[0] == pytest.approx(middle, abs=5e-4)
    assert shape[0] / 4 == pytest.approx(second, abs=2e-3 * second.max())


@pytest.mark.parametrize("name", CAMERAS)
def test_small_beads_appear_where_opencv_projects_their_centres(name: str) -> None:
    camera = CAMERAS[name]
    rng = np.random.default_rng(0)
    normals = rng.standard_normal((50, 3))
    normals[:, 2] = np.abs(normals[:, 2])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centre_px, _ = BeadProjector(camera, POSE).outlines(26.5 * normals, normals, np.full(50, 0.05), 0.8)
    assert np.abs(centre_px - _project(camera, POSE, 26.5 * normals)).max() < 1e-3


@pytest.mark.parametrize("softness_px", [0.0, 0.7, 1.5])
def test_drawn_disc_has_the_area_and_the_centroid_of_its_ellipse(softness_px: float) -> None:
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    half_axes = np.array([11.0, 7.0])
    shape = turn @ np.diag(half_axes**2) @ turn.T
    for x in np.linspace(30, 31, 7):
        centre = np.array([x, 41.3])
        drawn = BeadLayer(80, 90, softness_px, 0.0).draw(centre[None], shape[None]) / WHOLE
        rows, columns = np.mgrid[:90, :80]
        found = np.array([(drawn * columns).sum(), (drawn * rows).sum()]) / drawn.sum()
        assert drawn.max() == 1.0
        assert drawn.sum() == pytest.approx(np.pi * 11 * 7, rel=0.015 + 0.01 * softness_px**2)
        assert np.linalg.norm(found - centre) < 0.01


def test_edge_is_as_soft_as_the_lens() -> None:
    """Along a line through the middle, the edge's slope has the combined variance of pixel and blur."""
    drawn = BeadLayer(101, 101, 2.0, 0.0).draw(np.array([[50.0, 50.0]]), 30.0**2 * np.eye(2)[None])
    slope = -np.diff(drawn[50, 50:].astype(float)) / WHOLE
    place = np.arange(len(slope)) + 0.5
    mean = (slope * place).sum()
    assert mean == pytest.approx(30.0, abs=0.05)
    # the differences of samples widen it by half a pixel on each side: variance 1/12 more
    assert (slope * (place - mean) ** 2).sum() == pytest.approx(2.0**2 + 2 / 12, rel=0.05)


def test_adjacent_beads_do_not_erase_each_other_and_beads_outside_are_ignored() -> None:
    layer = BeadLayer(100, 60, 0.5, 0.0)
    shape = np.repeat(36.0 * np.eye(2)[None], 5, axis=0)
    centres = np.array([[40.0, 30.0], [51.0, 30.0], [-1.0, 20.0], [500.0, 30.0], [20.0, -300.0]])
    together = layer.draw(centres, shape).copy()
    one_by_one = np.max([layer.draw(c[None], shape[:1]).copy() for c in centres], axis=0)
    assert np.array_equal(together, one_by_one)
    assert together[20, 0] == WHOLE
    assert not layer.draw(np.zeros((0, 2)), np.zeros((0, 2, 2))).any()
