"""Exponential, logarithm and roll-pitch-yaw against scipy's Rotation."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate_host.common import rotation

components = st.floats(-1.0, 1.0)
vectors = st.tuples(components, components, components).map(np.array)
axes = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))


@given(vectors)
def test_exp_is_scipys(v):
    np.testing.assert_allclose(rotation.exp(v), Rotation.from_rotvec(v).as_matrix(), atol=1e-12)


@given(
    axes, st.one_of(st.floats(0, np.pi), st.floats(1e-12, 1e-6).map(lambda gap: np.pi - gap), st.just(np.pi))
)
@example(np.full(3, 3**-0.5), np.pi - 9.7e-7)  # R - R^T still counts here
def test_log_undoes_exp_up_to_half_a_turn(axis, angle):
    R = Rotation.from_rotvec(axis * angle).as_matrix()
    v = rotation.log(R)
    np.testing.assert_allclose(np.linalg.norm(v), angle, atol=1e-7)
    np.testing.assert_allclose(Rotation.from_rotvec(v).as_matrix(), R, atol=1e-7)


@given(st.floats(-179, 179), st.floats(-89, 89), st.floats(-179, 179))
def test_rpy_turns_about_fixed_axes(roll, pitch, yaw):
    R = rotation.from_rpy_deg(roll, pitch, yaw)
    expected = Rotation.from_euler("xyz", [roll, pitch, yaw], degrees=True).as_matrix()
    np.testing.assert_allclose(R, expected, atol=1e-12)
    np.testing.assert_allclose(rotation.to_rpy_deg(R), (roll, pitch, yaw), atol=1e-6)


@pytest.mark.parametrize("pitch", [90, -90])
def test_rpy_where_roll_and_yaw_turn_about_one_axis(pitch):
    R = Rotation.from_euler("xyz", [20, pitch, -40], degrees=True)
    found = rotation.to_rpy_deg(R.as_matrix())
    assert (Rotation.from_euler("xyz", found, degrees=True) * R.inv()).magnitude() < 1e-7


def test_angle():
    R = Rotation.from_rotvec([0, 0, np.radians(170)]).as_matrix()
    np.testing.assert_allclose(rotation.angle_deg(R), 170.0)


@given(vectors, vectors)
def test_cross_is_numpys(a, b):
    np.testing.assert_allclose(rotation.cross(a, b), np.cross(a, b), atol=1e-15)
