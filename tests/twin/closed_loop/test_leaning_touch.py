"""A rendered dome leans as the tip on the object does: its force has the tip's friction over normal force."""

import numpy as np
import pytest

from palpate_twin.camera import layouts
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.closed_loop.fingertip_feel import DomeTouch, press_of
from palpate_twin.dome import field_grid
from palpate_twin.dome.library import load_library


@pytest.fixture(scope="module")
def view():
    """Of a dome of another size than the library's."""
    view = CameraView(random_sensor(0, layouts.NAMES[0]), load_library())
    assert abs(view.dome.scale - 1.0) > 0.1
    return view


def touch_at(view, theta_deg, azimuth_deg, depth_mm, friction, along_deg):
    """2 N, and `friction` of it along a way in the face, from an axis of its own."""
    theta, azimuth = np.radians([theta_deg, azimuth_deg])
    out = np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])
    first = np.cross(out, [0.6, -0.8, 0.0])
    first /= np.linalg.norm(first)
    way = np.cos(np.radians(along_deg)) * first + np.sin(np.radians(along_deg)) * np.cross(out, first)
    into_mm = (view.twin.sensor.dome.outer_radius_mm - depth_mm) * out
    return out, DomeTouch(into_mm, 2.0, 2.0 * friction * way)


@pytest.mark.parametrize("along_deg", [0, 100, 200, 300])
@pytest.mark.parametrize(("theta_deg", "azimuth_deg"), [(3, 20), (25, -130), (50, 75), (70, 170)])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.45])
def test_its_force_leans_as_the_tips(view, theta_deg, azimuth_deg, friction, along_deg):
    out, touch = touch_at(view, theta_deg, azimuth_deg, 0.8, friction, along_deg)
    _, force_N = view.frame(press_of(view, touch), np.random.default_rng(1))
    normal_N = -force_N @ out
    assert normal_N > 0.0
    leans = (force_N + normal_N * out) / normal_N
    np.testing.assert_allclose(leans, touch.friction_N / touch.normal_force_N, atol=0.02)


def test_what_leans_more_than_the_fields_go_is_drawn_at_their_end(view):
    out, touch = touch_at(view, 30, 40, 0.8, 2.0, 60)
    press = press_of(view, touch)
    assert np.hypot(*press.shear_mm) == pytest.approx(field_grid.SHEAR_SHARES[-1] * press.depth_mm, rel=1e-6)
    _, force_N = view.frame(press, np.random.default_rng(1))
    tangential_N = force_N - force_N @ out * out
    assert tangential_N @ touch.friction_N > 0.9 * np.linalg.norm(tangential_N) * np.linalg.norm(
        touch.friction_N
    )


def test_a_tip_that_only_grazes_is_drawn(view):
    _, touch = touch_at(view, 30, 40, 0.0, 0.4, 60)
    assert press_of(view, touch).shear_mm == (0.0, 0.0)
