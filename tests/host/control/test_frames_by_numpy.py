"""Eqs. (12) and (16) by numpy's cross products, the limits of both frames, and the low-pass of rotations."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.control.virtual_frame import (
    FrameError,
    check_numbering,
    contact_frame,
    fit_contact_frame,
    low_pass,
    misfits_deg,
    virtual_frame,
)

TILT = Rotation.from_euler("xyz", (40.0, -25.0, 70.0), degrees=True).as_matrix()


def ring(count, radius_m=0.06):
    angle = 2.0 * np.pi * np.arange(count) / count
    return radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def unit(vector):
    return vector / np.linalg.norm(vector)


@pytest.mark.parametrize("count", [3, 4, 5])
@pytest.mark.parametrize("seed", range(3))
def test_the_frame_of_the_tips(count, seed):
    """z is the sum of the polygon's cross products, y from tip 3 to tip 2 without its part along z."""
    noise = np.random.default_rng(seed).normal(0.0, 0.01, (count, 3))
    tips = (ring(count) + noise) @ TILT.T + [0.1, -0.2, 0.3]
    z = unit(sum(np.cross(tips[k - 1] - tips[2], tips[k] - tips[2]) for k in range(count)))
    y = unit(tips[1] - tips[2] - z * (z @ (tips[1] - tips[2])))
    np.testing.assert_allclose(virtual_frame(tips), np.stack([np.cross(y, z), y, z], axis=1), atol=1e-12)


@pytest.mark.parametrize("count", [3, 4])
@pytest.mark.parametrize("seed", range(3))
def test_the_frame_of_the_contacts(count, seed):
    """z is the sum of the cross products of following normals, y is d_1 x z."""
    noise = np.random.default_rng(seed).normal(0.0, 0.2, (count, 3))
    normals = (ring(count, 1.0) + noise) @ TILT.T
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    z = unit(sum(np.cross(normals[k - 1], normals[k]) for k in range(count)))
    y = unit(np.cross(normals[0], z))
    np.testing.assert_allclose(contact_frame(normals), np.stack([np.cross(y, z), y, z], axis=1), atol=1e-12)


@pytest.mark.parametrize(("share", "is_flat"), [(1.01, False), (0.99, True)])
def test_a_triangle_is_flat_below_a_fiftieth_of_the_equilateral_ones_area(share, is_flat):
    height = share * 0.02 * math.sqrt(3.0) / 2.0
    tips = np.array([[0.0, 0.0, 0.1], [0.5, height, 0.1], [1.0, 0.0, 0.1]]) @ TILT.T
    if is_flat:
        with pytest.raises(FrameError, match="three fingertip centres lie on one line"):
            virtual_frame(tips)
    else:
        virtual_frame(tips)


@pytest.mark.parametrize(("share", "is_known"), [(1.01, True), (0.99, False)])
def test_normals_are_parallel_below_a_separation_of_0_05(share, is_known):
    """Three normals about z by an angle a: the sum of their cross products is 3 sin^2 a sin 120 deg."""
    sine = math.sqrt(share * 0.05 / (3.0 * math.sin(2.0 * math.pi / 3.0)))
    normals = ring(3, sine) + np.array([0.0, 0.0, math.sqrt(1.0 - sine * sine)])
    if is_known:
        contact_frame(normals)
    else:
        with pytest.raises(FrameError, match="nearly"):
            contact_frame(normals)


def test_fingers_count_counter_clockwise_from_above():
    check_numbering(ring(3))
    with pytest.raises(FrameError, match="numbered clockwise"):
        check_numbering(ring(3)[::-1])


def test_the_best_rotation_is_scipys():
    random = np.random.default_rng(3)
    reference = random.normal(size=(4, 3))
    reference /= np.linalg.norm(reference, axis=1, keepdims=True)
    normals = reference @ TILT.T + random.normal(0.0, 0.05, (4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    best = Rotation.align_vectors(normals, reference)[0].as_matrix()
    np.testing.assert_allclose(fit_contact_frame(reference, normals), best, atol=1e-9)
    angles = np.degrees(np.arccos(np.sum(normals * (reference @ best.T), axis=1)))
    np.testing.assert_allclose(misfits_deg(best, reference, normals), angles, atol=1e-6)


@pytest.mark.parametrize("time_constant_s", [0.1, 0.5])
def test_a_low_pass_goes_the_shortest_way_by_its_share(time_constant_s):
    start, end = Rotation.from_euler("z", 10.0, degrees=True), Rotation.from_euler("z", 50.0, degrees=True)
    found = low_pass(start.as_matrix(), end.as_matrix(), 0.02, time_constant_s)
    expected = 10.0 + 40.0 * (1.0 - math.exp(-0.02 / time_constant_s))
    assert Rotation.from_matrix(found).as_euler("zyx", degrees=True)[0] == pytest.approx(expected)
    np.testing.assert_array_equal(low_pass(start.as_matrix(), end.as_matrix(), 0.02, 0.0), end.as_matrix())
