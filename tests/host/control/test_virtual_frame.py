"""Eqs. (12), (15), (16): analytic cases, equivariance, the traps."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate_host.control.virtual_frame import (
    FrameError,
    check_numbering,
    contact_frame,
    desired_virtual_frame,
    fit_contact_frame,
    low_pass,
    misfits_deg,
    virtual_frame,
)

AZIMUTHS = np.radians([0, 120, 240])
TRIANGLE_M = 0.06 * np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1) + [0, 0, 0.1]
OUTWARDS = np.stack([np.cos(AZIMUTHS), np.sin(AZIMUTHS), np.zeros(3)], axis=1)

rotations = st.integers(0, 2**32 - 1).map(
    lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
)
points = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=(3, 3)))


def is_rotation(R):
    return np.allclose(R.T @ R, np.eye(3), atol=1e-9) and np.isclose(np.linalg.det(R), 1.0)


def test_eq_12_of_the_symmetric_hand():
    # y from tip 3 to tip 2, z up for counter-clockwise tips, x = y x z: towards tip 1.
    np.testing.assert_allclose(virtual_frame(TRIANGLE_M), np.eye(3), atol=1e-12)


def test_eq_16_is_half_a_turn_from_eq_12_in_a_symmetric_grasp():
    np.testing.assert_allclose(contact_frame(OUTWARDS), np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


@given(points, rotations)
def test_eq_12_turns_with_the_tips_and_ignores_their_place_and_scale(tips, R):
    try:
        frame = virtual_frame(tips)
    except FrameError:
        assume(False)
    assert is_rotation(frame)
    np.testing.assert_allclose(virtual_frame(0.03 * tips @ R.T + [1, -2, 3]), R @ frame, atol=1e-7)


@given(points, rotations)
def test_eq_16_turns_with_the_contacts(directions, R):
    normals = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    try:
        frame = contact_frame(normals)
    except FrameError:
        assume(False)
    assert is_rotation(frame)
    np.testing.assert_allclose(contact_frame(normals @ R.T), R @ frame, atol=1e-7)


@given(points, rotations)
def test_fit_is_the_true_turn_and_scipys(directions, R):
    reference = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    normals = reference @ R.T
    try:
        fitted = fit_contact_frame(reference, normals)
    except FrameError:
        assume(False)
    np.testing.assert_allclose(fitted, R, atol=1e-7)
    assert misfits_deg(fitted, reference, normals).max() < 1e-3


@given(rotations, st.integers(0, 2**32 - 1))
def test_noisy_fit_is_scipys_least_squares(R, seed):
    noise = np.random.default_rng(seed).normal(scale=0.05, size=(3, 3))
    normals = OUTWARDS @ R.T + noise
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    expected = Rotation.align_vectors(normals, OUTWARDS)[0].as_matrix()
    np.testing.assert_allclose(fit_contact_frame(OUTWARDS, normals), expected, atol=1e-6)


def test_fit_spreads_the_noise_of_finger_1_over_three():
    # Eq. (16) takes its yaw from finger 1 alone: 3 deg of error there are 3 deg of yaw; the fit makes it 1.
    turned = OUTWARDS.copy()
    turned[0] = Rotation.from_euler("z", 3, degrees=True).apply(OUTWARDS[0])
    plain = contact_frame(turned) @ contact_frame(OUTWARDS).T
    fitted = fit_contact_frame(OUTWARDS, turned)
    assert np.degrees(Rotation.from_matrix(plain).magnitude()) == pytest.approx(3.0)
    assert np.degrees(Rotation.from_matrix(fitted).magnitude()) == pytest.approx(1.0, abs=0.01)


def test_clockwise_numbering_is_refused():
    check_numbering(TRIANGLE_M)
    with pytest.raises(FrameError, match=r"clockwise.*exchange two entries"):
        check_numbering(TRIANGLE_M[[0, 2, 1]])


def test_tips_on_a_line_are_refused():
    with pytest.raises(FrameError, match=r"on one line.*Eq. \(12\)"):
        virtual_frame(np.outer([0.0, 1.0, 2.0], [1.0, 2.0, 3.0]))
    with pytest.raises(FrameError):
        virtual_frame(np.zeros((3, 3)))


@pytest.mark.parametrize(
    "normals",
    [
        np.array([[1.0, 0, 0], [-1, 0, 0], [-1, 0, 0]]),  # two fingers oppose one: r_cz is 0/0
        np.array([[1.0, 0, 0], [1, 0, 0], [1, 0, 0]]),
    ],
    ids=["opposed", "equal"],
)
def test_collinear_contacts_are_refused(normals):
    with pytest.raises(FrameError, match=r"parallel.*Eq. \(16\)"):
        contact_frame(normals)
    with pytest.raises(FrameError, match="parallel"):
        fit_contact_frame(normals, normals)


@given(rotations, rotations, rotations)
def test_eq_15_paired_in_time(R_vir_now, R_vir_then, R_c_then):
    # With the target equal to where the object is now, the desired virtual frame is the virtual frame.
    M = R_vir_then.T @ R_c_then
    R_c_now = R_vir_now @ R_vir_then.T @ R_c_then
    np.testing.assert_allclose(desired_virtual_frame(R_c_now, M), R_vir_now, atol=1e-9)
    # And as printed: R_d R_c^T(t - tau) R_vir(t - tau).
    np.testing.assert_allclose(desired_virtual_frame(np.eye(3), M), R_c_then.T @ R_vir_then, atol=1e-9)


@given(rotations, st.floats(0.01, 2.0))
def test_low_pass_goes_the_exponential_share_of_the_way(start, time_s):
    goal = start @ Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    reached = low_pass(start, goal, time_s, 0.5)
    gone = Rotation.from_matrix(start.T @ reached).magnitude()
    whole = np.linalg.norm([0.3, -0.2, 0.5])
    np.testing.assert_allclose(gone, whole * (1 - np.exp(-time_s / 0.5)), atol=1e-7)
    np.testing.assert_array_equal(low_pass(start, goal, time_s, 0.0), goal)
