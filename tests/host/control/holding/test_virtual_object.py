"""The pose of the virtual object against rolling contacts that scipy integrates, and contact normals."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from palpate_host.control.holding.virtual_object import VirtualObject
from palpate_host.control.kinematics import HandPose

RADIUS_M = np.array([0.03, 0.028, 0.03])
NORMAL_IN_OBJECT = np.array([[1.0, 0, 0], [-0.5, np.sqrt(0.75), 0], [-0.5, -np.sqrt(0.75), 0]])
PLACE_M = np.array([0.01, -0.02, 0.1])
SPIN = np.array([0.3, -0.2, 0.4])
VELOCITY = np.array([0.01, 0.02, -0.03])
TIP_SPIN = np.array([[0.2, 0.5, 0.0], [-0.4, 0.1, 0.3], [0.0, -0.3, -0.6]])
STEP_S = 1e-3


def rolling(seconds):
    """Return times, and the tips' centres (t, 3, 3) that roll on an object of constant velocity and spin.

    Eq. (6): the skin of the tip at the contact has the velocity of the object's face there.
    """

    def rate(t, centres):
        R = Rotation.from_rotvec(SPIN * t).as_matrix()
        normal = NORMAL_IN_OBJECT @ R.T
        centre = centres.reshape(3, 3)
        contact = centre - RADIUS_M[:, None] * normal
        face = VELOCITY + np.cross(SPIN, contact - (PLACE_M + VELOCITY * t))
        return (face - np.cross(TIP_SPIN, contact - centre)).ravel()

    times = np.arange(0.0, seconds, STEP_S)
    start = PLACE_M + (0.04 + RADIUS_M[:, None]) * NORMAL_IN_OBJECT
    solved = solve_ivp(rate, (0, seconds), start.ravel(), t_eval=times, rtol=1e-10, atol=1e-12)
    return times, solved.y.T.reshape(-1, 3, 3)


def pose_at(t, centre):
    """The pose of three tips that turn with TIP_SPIN; q is the time, which makes each pose unique."""
    turned = Rotation.from_rotvec(TIP_SPIN * t).as_matrix()
    nothing = np.zeros((3, 3, 1))
    return HandPose(np.array([t]), centre, nothing, turned, np.zeros(1), nothing)


def object_at(pose, R=None, doubt_deg=8.0):
    return VirtualObject(pose, NORMAL_IN_OBJECT, np.eye(3) if R is None else R, RADIUS_M, doubt_deg)


def test_rolling_tips_carry_the_estimate_with_the_object():
    times, centres = rolling(1.0)
    found = object_at(pose_at(0.0, centres[0]))
    arm = found.place_m - PLACE_M  # the contacts' centroid is a point of the object, not its origin
    for t, centre in zip(times[1:], centres[1:], strict=True):
        found.advance(pose_at(t, centre), STEP_S)
    turned = Rotation.from_rotvec(SPIN * times[-1])
    assert np.degrees((Rotation.from_matrix(found.R) * turned.inv()).magnitude()) < 0.05
    true_place = PLACE_M + VELOCITY * times[-1] + turned.apply(arm)
    np.testing.assert_allclose(found.place_m, true_place, atol=5e-5)
    np.testing.assert_allclose(found.twist[3:], SPIN, atol=2e-3)


def test_late_normals_turn_a_wrong_estimate_to_the_object():
    """Started 4 deg wrong, corrected at 30 Hz with normals that are 60 ms old, while the object turns."""
    times, centres = rolling(1.5)
    wrong = Rotation.from_rotvec(np.radians([2.0, -2.0, 2.8])).as_matrix()
    found = VirtualObject(pose_at(0.0, centres[0]), NORMAL_IN_OBJECT, np.eye(3), RADIUS_M, 8.0)
    found.R = wrong
    found._kept_R[:] = wrong
    late = 60
    for k in range(1, len(times)):
        found.advance(pose_at(times[k], centres[k]), STEP_S)
        if k % 33 == 0 and k > late:
            then = times[k - late]
            R = Rotation.from_rotvec(SPIN * then).as_matrix()
            for finger in range(3):
                pose = pose_at(then, centres[k - late])
                assert found.correct(finger, R @ NORMAL_IN_OBJECT[finger], pose, 0.1)
    error = Rotation.from_matrix(found.R) * Rotation.from_rotvec(SPIN * times[-1]).inv()
    assert np.degrees(error.magnitude()) < 0.25


def test_a_normal_in_doubt_changes_nothing():
    _, centres = rolling(0.01)
    pose = pose_at(0.0, centres[0])
    found = object_at(pose)
    outlier = Rotation.from_euler("z", 12.0, degrees=True).apply(NORMAL_IN_OBJECT[0])
    assert not found.correct(0, outlier, pose, 0.5)
    assert found.residual_deg == pytest.approx(12.0)
    assert found.doubted == 1
    np.testing.assert_array_equal(found.R, np.eye(3))
    found.touch_elsewhere(0, outlier)
    assert found.correct(0, outlier, pose, 0.5)
    np.testing.assert_allclose(found.R, np.eye(3), atol=1e-12)


def turned_deg(found):
    return Rotation.from_matrix(found.R).as_rotvec(degrees=True)


def seen(finger, angle_deg, axis=(0.0, 0.0, 1.0)):
    """One finger's normal after a turn about an axis of unit length."""
    turn = Rotation.from_rotvec(np.radians(angle_deg) * np.asarray(axis))
    return turn.apply(NORMAL_IN_OBJECT[finger])


def test_a_normal_corrects_by_the_angle_beyond_its_own_radius():
    """A normal 1 deg away with a radius of 0.4 deg turns by half of 0.6 deg; with 1.1 deg not at all."""
    _, centres = rolling(0.01)
    pose = pose_at(0.0, centres[0])
    found = object_at(pose)
    for finger in range(2):
        assert found.correct(finger, seen(finger, 1.0), pose, 0.5, np.radians(1.1))
        np.testing.assert_array_equal(found.R, np.eye(3))
        assert found.residual_deg == pytest.approx(1.0)
    assert found.correct(0, seen(0, 1.0), pose, 0.5, np.radians(0.4))
    np.testing.assert_allclose(turned_deg(found), [0.0, 0.0, 0.3], atol=1e-4)


def test_the_radius_of_the_reference_counts_as_well():
    """Radii of 0.3 and 0.4 deg are 0.5 deg together; a face that is taken has none, another one its own."""
    _, centres = rolling(0.01)
    pose = pose_at(0.0, centres[0])
    reference_rad = np.radians([0.3, 0.0, 0.0])

    def corrected(take=lambda _found: None):
        found = VirtualObject(pose, NORMAL_IN_OBJECT, np.eye(3), RADIUS_M, 8.0, list(reference_rad))
        take(found)
        assert found.correct(1, seen(1, 1.0), pose, 0.5, np.radians(1.1))
        assert found.correct(0, seen(0, 1.0), pose, 0.5, np.radians(0.4))
        return turned_deg(found)[2]

    assert corrected() == pytest.approx(0.5 * (1.0 - 0.5), abs=1e-4)
    taken = corrected(lambda found: found.take_face(0, NORMAL_IN_OBJECT[0]))
    assert taken == pytest.approx(0.5 * (1.0 - 0.4), abs=1e-4)
    touched = corrected(lambda found: found.touch_elsewhere(0, NORMAL_IN_OBJECT[0], np.radians(0.8)))
    assert touched == pytest.approx(0.5 * (1.0 - np.hypot(0.4, 0.8)), abs=1e-4)


@pytest.mark.parametrize(("shown_deg", "is_confirmed"), [(0.0, False), (0.98, False), (1.02, True)])
def test_another_finger_shows_half_of_the_turn_or_none_counts(shown_deg, is_confirmed):
    """Without a radius a normal needs no other finger."""
    _, centres = rolling(0.01)
    pose = pose_at(0.0, centres[0])
    found = object_at(pose)
    assert found.correct(1, seen(1, shown_deg), pose, 0.5, np.radians(1.5))
    assert found.correct(0, seen(0, 2.0), pose, 0.5, np.radians(1.0))
    np.testing.assert_allclose(turned_deg(found)[2], 0.5 if is_confirmed else 0.0, atol=1e-3)
    alone = object_at(pose)
    assert alone.correct(0, seen(0, 2.0), pose, 0.5)
    np.testing.assert_allclose(turned_deg(alone)[2], 1.0, atol=1e-3)


def test_a_finger_confirms_no_turn_about_its_own_normal():
    _, centres = rolling(0.01)
    pose = pose_at(0.0, centres[0])
    found = object_at(pose)
    axis = NORMAL_IN_OBJECT[1]
    assert found.correct(1, seen(1, 2.0, axis), pose, 0.5, np.radians(0.1))
    assert found.correct(0, seen(0, 2.0, axis), pose, 0.5, np.radians(0.1))
    np.testing.assert_array_equal(found.R, np.eye(3))
