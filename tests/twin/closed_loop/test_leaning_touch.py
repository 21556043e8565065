"""A rendered dome has the same ratio of tangential to normal force as the simulated tip."""

import numpy as np
import pytest

from palpate_twin.camera import layouts
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.closed_loop.tactile_rendering import DomeContact, press_for
from palpate_twin.dome import field_grid
from palpate_twin.dome.library import load_library


@pytest.fixture(scope="module")
def view():
    """Return the camera view of a dome whose size differs from the library's."""
    view = CameraView(random_sensor(0, layouts.NAMES[0]), load_library())
    assert abs(view.dome.scale - 1.0) > 0.1
    return view


def contact_at(view, theta_deg, azimuth_deg, depth_mm, friction, along_deg):
    """Return the outward normal and a contact of 2 N with a tangential force of `friction` times 2 N."""
    theta, azimuth = np.radians([theta_deg, azimuth_deg])
    out = np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])
    first = np.cross(out, [0.6, -0.8, 0.0])
    first /= np.linalg.norm(first)
    along = np.cos(np.radians(along_deg)) * first + np.sin(np.radians(along_deg)) * np.cross(out, first)
    centre_to_contact_mm = (view.twin.sensor.dome.outer_radius_mm - depth_mm) * out
    return out, DomeContact(centre_to_contact_mm, 2.0, 2.0 * friction * along)


@pytest.mark.parametrize("along_deg", [0, 100, 200, 300])
@pytest.mark.parametrize(("theta_deg", "azimuth_deg"), [(3, 20), (25, -130), (50, 75), (70, 170)])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.45])
def test_the_force_ratio_of_the_dome_is_that_of_the_tip(view, theta_deg, azimuth_deg, friction, along_deg):
    out, contact = contact_at(view, theta_deg, azimuth_deg, 0.8, friction, along_deg)
    _, force_N = view.frame(press_for(view, contact), np.random.default_rng(1))
    normal_N = -force_N @ out
    assert normal_N > 0.0
    ratio = (force_N + normal_N * out) / normal_N
    np.testing.assert_allclose(ratio, contact.friction_N / contact.normal_force_N, atol=0.02)


def test_a_larger_ratio_than_the_librarys_is_rendered_with_its_largest_slide(view):
    out, contact = contact_at(view, 30, 40, 0.8, 2.0, 60)
    press = press_for(view, contact)
    assert np.hypot(*press.shear_mm) == pytest.approx(field_grid.SHEAR_SHARES[-1] * press.depth_mm, rel=1e-6)
    _, force_N = view.frame(press, np.random.default_rng(1))
    tangential_N = force_N - force_N @ out * out
    assert tangential_N @ contact.friction_N > 0.9 * np.linalg.norm(tangential_N) * np.linalg.norm(
        contact.friction_N
    )


def test_a_contact_without_indentation_is_rendered_without_slide(view):
    _, contact = contact_at(view, 30, 40, 0.0, 0.4, 60)
    assert press_for(view, contact).shear_mm == (0.0, 0.0)
