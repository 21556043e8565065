"""The grip's moments by numpy's inverse, and the virtual object carried by tips that move rigidly with it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.control.holding.virtual_object import (
    KEEP_EVERY_S,
    KEPT,
    VirtualObject,
    grip_of,
    moment_rows,
    times,
)
from palpate_host.control.kinematics import HandPose

RADIUS_M = np.array([0.03, 0.028, 0.026])
NORMAL = np.array([[1.0, 0.0, 0.0], [-0.6, 0.8, 0.0], [0.0, -0.6, 0.8]])
CONTACT_M = np.array([[0.05, 0.01, 0.1], [-0.03, 0.04, 0.11], [0.0, -0.04, 0.13]])
CENTRE_M = CONTACT_M + RADIUS_M[:, None] * NORMAL
SHARE = np.array([1.0, 0.5, 0.25])
STEP_S = 0.002


def pose_at(centre_m, turned=None, q=0.0):
    nothing = np.zeros((3, 3, 1))
    tip = np.tile(np.eye(3) if turned is None else turned, (3, 1, 1))
    return HandPose(np.array([q]), centre_m, nothing, tip, np.zeros(1), nothing)


def object_here(doubt_deg=8.0):
    return VirtualObject(pose_at(CENTRE_M), NORMAL, np.eye(3), RADIUS_M, doubt_deg)


@pytest.mark.parametrize("share", [None, SHARE])
def test_the_moments_of_a_grip(share):
    """S is the sum of w (|a|^2 I - a a^T), w the squared shares; centroid and arms likewise."""
    grip = grip_of(CENTRE_M, NORMAL, RADIUS_M[:, None], share)
    weight = np.ones(3) if share is None else share**2
    centroid = weight @ CONTACT_M / weight.sum()
    arm = CONTACT_M - centroid
    spread = sum(w * (a @ a * np.eye(3) - np.outer(a, a)) for w, a in zip(weight, arm, strict=True))
    np.testing.assert_allclose(grip.centroid_m, centroid, atol=1e-15)
    np.testing.assert_allclose(grip.arm_m, arm, atol=1e-15)
    np.testing.assert_allclose(grip.weighted_arm_m, weight[:, None] * arm, atol=1e-15)
    np.testing.assert_allclose(grip.to_contact_m, CONTACT_M - CENTRE_M, atol=1e-15)
    np.testing.assert_allclose(grip.per_spread, np.linalg.inv(spread), rtol=1e-9)
    np.testing.assert_allclose(grip.mean_weight, weight / weight.sum())
    assert grip.spread_m2 == pytest.approx(weight @ (arm**2).sum(axis=1))
    assert grip.total_weight == pytest.approx(weight.sum())


def test_moments_are_cross_products():
    arm, force = np.random.default_rng(1).normal(size=(2, 4, 3))
    got = moment_rows(arm.tolist(), force.tolist())
    np.testing.assert_allclose(got, np.cross(arm, force), atol=1e-14)
    np.testing.assert_allclose(times(arm[:3].tolist(), force[0].tolist()), arm[:3] @ force[0], atol=1e-14)


@pytest.mark.parametrize("share", [np.ones(3), SHARE])
def test_tips_that_move_with_the_object_carry_place_and_orientation(share):
    """A rigid motion of all tips: to first order in the angle the estimate is that motion."""
    spin, velocity = np.array([0.2, -0.1, 0.15]), np.array([0.03, -0.01, 0.02])
    turn = Rotation.from_rotvec(spin * STEP_S).as_matrix()
    pivot_m = np.array([0.01, 0.0, 0.12])
    moved_m = (CENTRE_M - pivot_m) @ turn.T + pivot_m + velocity * STEP_S
    found = object_here()
    found.set_share(share)
    place_m = found.place_m
    grip = found.advance(pose_at(moved_m, turn), STEP_S)
    np.testing.assert_allclose(found.R, turn, atol=3e-7)
    expected_m = turn @ (place_m - pivot_m) + pivot_m + velocity * STEP_S
    np.testing.assert_allclose(found.place_m, expected_m, atol=1e-8)
    np.testing.assert_allclose(found.twist[3:], spin, atol=2e-4)
    np.testing.assert_allclose(found.twist[:3], (expected_m - place_m) / STEP_S, atol=1e-5)
    np.testing.assert_allclose(grip.normal, NORMAL @ turn.T, atol=1e-6)
    assert grip is found.grip


def test_only_a_change_of_shares_makes_a_new_grip():
    found = object_here()
    whole = found.grip
    share = SHARE.copy()
    found.set_share(share)
    part = found.grip
    assert part.total_weight == pytest.approx((SHARE**2).sum())
    found.set_share(share)
    assert found.grip is part
    found.set_share(np.ones(3))
    np.testing.assert_array_equal(found.grip.arm_m, whole.arm_m)
    assert found.grip.share is None


def test_a_correction_turns_by_its_share_towards_the_measured_normal():
    found = object_here()
    turned = Rotation.from_rotvec([0.0, 0.0, np.radians(2.0)])
    assert found.correct(0, turned.apply(NORMAL[0]), pose_at(CENTRE_M), 0.25)
    assert found.residual_deg == pytest.approx(2.0)
    got = Rotation.from_matrix(found.R).as_rotvec(degrees=True)
    np.testing.assert_allclose(got, [0.0, 0.0, 0.5], atol=1e-3)
    assert found.doubted == 0


@pytest.mark.parametrize(("angle_deg", "is_taken"), [(7.99, True), (8.01, False)])
def test_a_normal_is_in_doubt_beyond_the_angle(angle_deg, is_taken):
    found = object_here()
    normal = Rotation.from_euler("z", angle_deg, degrees=True).apply(NORMAL[0])
    assert found.correct(0, normal, pose_at(CENTRE_M), 0.1) is is_taken
    assert found.doubted == int(not is_taken)


def test_a_late_normal_is_compared_with_the_estimate_of_its_exposure():
    """The object turned by 3 deg meanwhile: the normal of then is exact then, and changes nothing now."""
    found = object_here()
    turn = Rotation.from_euler("z", 3.0, degrees=True).as_matrix()
    before = pose_at(CENTRE_M, q=0.0)
    found.advance(before, KEEP_EVERY_S)
    after = pose_at(CENTRE_M @ turn.T, turn, q=1.0)
    found.advance(after, KEEP_EVERY_S)
    now = found.R
    assert found.correct(0, NORMAL[0], before, 0.5)
    assert found.residual_deg < 1e-6
    np.testing.assert_allclose(found.R, now, atol=1e-12)
    assert found.correct(0, NORMAL[0], after, 0.5)
    assert found.residual_deg == pytest.approx(3.0, abs=0.01)


def test_estimates_are_kept_every_4_ms_for_half_a_second():
    """The 129th pose overwrites the first of the 128 that are kept."""
    found = object_here()
    turn = Rotation.from_euler("z", 5.0, degrees=True).as_matrix()
    found.advance(pose_at(CENTRE_M, q=-7.0), KEEP_EVERY_S / 2)  # too soon to be kept
    found.advance(pose_at(CENTRE_M @ turn.T, turn, q=1.0), KEEP_EVERY_S / 2)
    assert found.correct(0, found.R @ NORMAL[0], pose_at(CENTRE_M, q=1.0), 0.1)
    assert found.residual_deg < 1e-6
    for k in range(KEPT):
        assert (found._kept_q[:, 0] == 1.0).any()
        found.advance(pose_at(CENTRE_M @ turn.T, turn, q=2.0 + k), KEEP_EVERY_S)
    assert not (found._kept_q[:, 0] == 1.0).any()
    assert not (found._kept_q[:, 0] == -7.0).any()


def test_the_reference_of_a_finger_is_replaced_by_a_face_or_a_measured_normal():
    found = object_here()
    found.R = Rotation.from_euler("z", 30.0, degrees=True).as_matrix()
    found._kept_R[:] = found.R
    face = np.array([0.0, 0.0, 1.0])
    found.take_face(1, face)
    assert found.correct(1, found.R @ face, pose_at(CENTRE_M), 0.5) and found.residual_deg < 1e-6
    measured = np.array([0.0, 1.0, 0.0])
    found.touch_elsewhere(2, measured)
    assert found.correct(2, measured, pose_at(CENTRE_M), 0.5) and found.residual_deg < 1e-6


def test_the_radius_moves_the_contacts_of_the_next_tick():
    found = object_here()
    np.testing.assert_array_equal(found.radius_m, RADIUS_M)
    found.set_radius(RADIUS_M - 0.002)
    grip = found.advance(pose_at(CENTRE_M), STEP_S)
    np.testing.assert_allclose(grip.to_contact_m, -(RADIUS_M - 0.002)[:, None] * NORMAL, atol=1e-12)
