"""The camera's projection, compared with textbook formulas, its inverse, and the fit of its pose."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate_edge.geometry.camera_pose import fit_pose, pose_from
from palpate_edge.geometry.sensor import Camera, CameraPose, Markers, Ring, Sensor, View, bead_layout_mm

PINHOLE = Camera(640, 480, (380.0, 370.0, 322.0, 238.0), (0.0, 0.0, -45.0))
FISHEYE = Camera(
    640, 480, (300.0, 295.0, 318.0, 243.0), (0.0, 0.0, -30.0), 30.0, "fisheye", (0.05, -0.01, 0.004, -0.001)
)
LENS = msgspec.structs.replace(PINHOLE, distortion=(-0.12, 0.03, 0.001, -0.0005, 0.01))
POSE = CameraPose((0.6, -0.4, 0.3), (0.02, -0.03, 0.05), 1.02)
CAMERAS = [pytest.param(c, id=n) for c, n in ((PINHOLE, "pinhole"), (LENS, "lens"), (FISHEYE, "fisheye"))]

on_the_dome = st.tuples(st.floats(0, math.radians(80)), st.floats(-math.pi, math.pi))


def on_sphere(theta, phi, radius_mm=26.5):
    return radius_mm * np.array(
        [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)]
    )


def in_camera(point_mm, camera, pose):
    turned = Rotation.from_rotvec(pose.rotation_rad).inv()
    return turned.apply(point_mm - np.array(camera.position_mm) - np.array(pose.offset_mm))


def lens_pixel(point_mm, camera, pose):
    """Pinhole camera with radial k1, k2, k3 and tangential p1, p2 (Brown's model)."""
    x, y, z = in_camera(point_mm, camera, pose)
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = (*camera.distortion, 0.0)[:5]
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    fx, fy, cx, cy = camera.matrix
    return fx * pose.focal_scale * u + cx, fy * pose.focal_scale * v + cy


def fisheye_pixel(point_mm, camera, pose):
    """r = f theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8) (Kannala and Brandt)."""
    x, y, z = in_camera(point_mm, camera, pose)
    theta = math.atan2(math.hypot(x, y), z)
    radius = theta * (1 + sum(k * theta ** (2 * n) for n, k in enumerate(camera.distortion, start=1)))
    phi = math.atan2(y, x)
    fx, fy, cx, cy = camera.matrix
    scale = pose.focal_scale
    return fx * scale * radius * math.cos(phi) + cx, fy * scale * radius * math.sin(phi) + cy


@pytest.mark.parametrize("camera", CAMERAS)
@given(where=on_the_dome)
def test_projection_is_the_textbook_formula(camera, where):
    point = on_sphere(*where)
    formula = fisheye_pixel if camera.model == "fisheye" else lens_pixel
    assert View(camera, POSE).project(point[None])[0] == pytest.approx(formula(point, camera, POSE), abs=1e-6)


@pytest.mark.parametrize("camera", CAMERAS)
def test_slopes_are_the_differences_of_the_textbook_formula(camera):
    formula = fisheye_pixel if camera.model == "fisheye" else lens_pixel
    parameters = np.array([*POSE.offset_mm, *POSE.rotation_rad, POSE.focal_scale - 1])
    points = np.array([on_sphere(0.0, 0.0), on_sphere(0.7, 0.4), on_sphere(1.2, -2.0)])
    pixels, slopes = View(camera, POSE).project_with_slopes(points)
    assert pixels == pytest.approx(View(camera, POSE).project(points))
    for number, step in enumerate(1e-6 * np.eye(7)):
        further, back = pose_from(parameters + step), pose_from(parameters - step)
        differences = [
            np.subtract(formula(point, camera, further), formula(point, camera, back)) for point in points
        ]
        assert slopes[:, :, number] == pytest.approx(np.array(differences) / 2e-6, abs=1e-5)


@pytest.mark.parametrize("camera", CAMERAS)
@settings(deadline=None)
@given(where=on_the_dome)
def test_a_pixel_goes_back_to_the_point_it_came_from(camera, where):
    view, point = View(camera, POSE), on_sphere(*where)
    back = view.onto_sphere(view.project(point[None]), 26.5)[0]
    assert np.linalg.norm(back - point) < 0.02
    assert np.linalg.norm(back) == pytest.approx(26.5)


def test_a_ray_that_misses_the_sphere_is_nan():
    corner = View(PINHOLE).onto_sphere(np.array([[2000.0, 240.0]]), 26.5)
    assert np.isnan(corner).all()


def test_the_layout_is_where_the_rings_say():
    markers = Markers(26.5, 3.0, (Ring(0, 1), Ring(60, 4, 30)))
    points, ring_of = bead_layout_mm(markers)
    assert ring_of.tolist() == [0, 1, 1, 1, 1]
    assert points[0] == pytest.approx((0, 0, 26.5))
    for number, phi_deg in enumerate((30, 120, 210, 300), start=1):
        assert points[number] == pytest.approx(on_sphere(math.radians(60), math.radians(phi_deg)))


@settings(max_examples=15, deadline=None)
@given(
    offset=st.tuples(*3 * [st.floats(-0.6, 0.6)]),
    tilt=st.tuples(*3 * [st.floats(-0.02, 0.02)]),
    scale=st.floats(0.98, 1.02),
)
@pytest.mark.parametrize("camera", CAMERAS)
def test_fit_finds_where_the_camera_looks(drawn_dome, camera, offset, tilt, scale):
    """Beads come to lie within a fraction of a pixel, also where offset and tilt look alike."""
    layout = drawn_dome.beads_mm()
    pixels = View(camera, CameraPose(offset, tilt, scale)).project(layout)
    fitted = View(camera, fit_pose(camera, layout, pixels)).project(layout)
    assert np.linalg.norm(fitted - pixels, axis=1).max() < 0.35


def test_fit_recovers_a_pose(drawn_dome):
    layout = drawn_dome.beads_mm()
    pixels = View(PINHOLE, CameraPose((0.3, -0.2, 0.0), (0.0, 0.0, 0.015), 1.0)).project(layout)
    pose = fit_pose(PINHOLE, layout, pixels)
    assert pose.offset_mm == pytest.approx((0.3, -0.2, 0.0), abs=0.15)
    assert pose.rotation_rad == pytest.approx((0.0, 0.0, 0.015), abs=0.003)
    assert pose.focal_scale == pytest.approx(1.0, abs=0.003)


def test_a_few_wrong_pairs_do_not_bend_the_fit(drawn_dome):
    layout = drawn_dome.beads_mm()
    pixels = View(PINHOLE, POSE).project(layout)
    spoilt = pixels.copy()
    spoilt[[5, 30, 50, 80]] += (14, -9)
    fitted = View(PINHOLE, fit_pose(PINHOLE, layout, spoilt)).project(layout)
    assert np.linalg.norm(fitted - pixels, axis=1).max() < 1.0


def test_the_fingerprint_changes_with_all_but_the_frame_rate(drawn_dome):
    sensor = msgspec.toml.decode(drawn_dome.sensor_toml(), type=Sensor)
    replace = msgspec.structs.replace
    same = replace(sensor, camera=replace(sensor.camera, fps=60.0))
    assert same.fingerprint() == sensor.fingerprint()
    others = [
        replace(sensor, dome=replace(sensor.dome, wall_mm=4.0)),
        replace(sensor, markers=replace(sensor.markers, rings=sensor.markers.rings[:-1])),
        replace(sensor, camera=replace(sensor.camera, distortion=(0.0, 0.0, 0.0, 1e-6))),
        replace(sensor, camera=replace(sensor.camera, width=641)),
    ]
    prints = {sensor.fingerprint(), *(other.fingerprint() for other in others)}
    assert len(prints) == 5
