"""HOLD under the pose law: carrying torques, a stiffness that is stable for any contacts, a bounded grip."""

from dataclasses import replace

import numpy as np
import pytest

from palpate_host.config.packaged import MODELS
from palpate_host.control.gains import gains_of
from palpate_host.control.holding.grasp_forces import ContactForces
from palpate_host.control.holding.joint_hold import joint_hold
from palpate_host.control.holding.virtual_object import grip_of
from palpate_host.control.object_orientation import contact_normal
from palpate_host.service.host import load_hand

Q_RAD = np.tile([0.0, 0.1405, 1.4285], 3) + np.linspace(-0.05, 0.05, 9)
STILL = np.zeros(9)
MOST_N, FRICTION = 5.0, (0.4, 0.4, 0.4)
UNCHANGED_M = np.zeros(3)


@pytest.fixture(scope="module")
def wide():
    config, hand = load_hand(MODELS / "table4-wide.toml")
    return gains_of(config), hand


def grip_at(pose):
    normal = np.array([contact_normal(pose, finger, (0.0, 0.0, 30.0)) for finger in range(3)])
    return grip_of(pose.tip_centre_m, normal, np.full((3, 1), 0.03))


def forces_on(grip):
    force_N = -4.0 * grip.normal + np.array([[0.3, -0.2, 1.0]] * 3)
    return ContactForces(force_N, -np.vecdot(force_N, grip.normal), 4.0, 1.0, 0.1)


def skin_jacobian_m(hand, grip):
    """Central differences (9, 9) of the points of the tips' skin that are at the contacts."""
    in_tip = np.einsum("iba,ib->ia", hand.pose(Q_RAD).tip_rotation, grip.to_contact_m)

    def skin_m(q_rad):
        pose = hand.pose(q_rad)
        return (pose.tip_centre_m + np.einsum("iab,ib->ia", pose.tip_rotation, in_tip)).ravel()

    step = 1e-6
    return np.stack(
        [(skin_m(Q_RAD + step * e) - skin_m(Q_RAD - step * e)) / (2 * step) for e in np.eye(9)], 1
    )


def test_the_torques_do_the_work_of_the_last_forces(wide):
    """u dq = sum f_i dx_i for every joint, beside gravity."""
    gains, hand = wide
    pose = hand.pose(Q_RAD)
    grip = grip_at(pose)
    forces = forces_on(grip)
    hold = joint_hold(Q_RAD, FRICTION, gains, 0.01)
    expected = skin_jacobian_m(hand, grip).T @ forces.force_N.ravel() + pose.gravity_Nm
    np.testing.assert_allclose(
        hold.torque_Nm(pose, STILL, grip, forces, MOST_N, gains, UNCHANGED_M), expected, atol=1e-7
    )
    damped = hold.torque_Nm(pose, np.ones(9), grip, forces, MOST_N, gains, UNCHANGED_M)
    np.testing.assert_allclose(damped, expected - gains.B_Nms_rad, atol=1e-7)


@pytest.mark.parametrize(("tick_s", "rate_per_s"), [(0.02, 12.5), (0.01, 25.0), (0.001, 25.0)])
def test_the_stiffness_is_stable_whatever_the_contacts_leave_free(wide, tick_s, rate_per_s):
    """Motions of one to five freedoms with a delay of two ticks: they end, and grow with four times K."""
    gains = wide[0]
    K = joint_hold(Q_RAD, FRICTION, gains, tick_s).stiffness_Nm_rad
    np.testing.assert_allclose(K / gains.B_Nms_rad, rate_per_s)
    steps = 20
    rng = np.random.default_rng(0)
    for freedoms in range(1, 6):
        A = rng.normal(size=(9, freedoms))
        rates = np.linalg.solve(A.T @ np.diag(gains.B_Nms_rad) @ A, A.T @ np.diag(K) @ A)

        def left(factor, freedoms=freedoms, rates=rates):
            z = [np.ones(freedoms)] * (2 * steps + 1)
            for _ in range(200 * steps):
                z.append(z[-1] - factor * rates @ z[-2 * steps - 1] * tick_s / steps)
            return np.abs(z[-1]).max()

        assert left(1.0) < 0.02
        if tick_s >= 0.01:  # where the tick is the limit
            assert left(4.0) > 1.0


def test_the_stiffness_never_presses_a_tip_with_more_than_the_limit(wide):
    gains, hand = wide
    pose = hand.pose(Q_RAD)
    grip = grip_at(pose)
    forces = forces_on(grip)
    hold = joint_hold(Q_RAD, FRICTION, gains, 0.01)
    J = skin_jacobian_m(hand, grip)
    apart_rad = np.linalg.solve(J, (0.02 * grip.normal).ravel())

    def pressing_N(moved_rad, most_N):
        """Normal forces (3,) that the torques at Q_RAD balance, when q_H is that far from there."""
        moved = replace(hold, q_rad=Q_RAD - moved_rad)
        u = moved.torque_Nm(pose, STILL, grip, forces, most_N, gains, UNCHANGED_M) - pose.gravity_Nm
        return -np.vecdot(np.linalg.solve(J.T, u).reshape(3, 3), grip.normal)

    assert pressing_N(apart_rad, np.inf).min() > 1.2 * MOST_N
    np.testing.assert_allclose(pressing_N(apart_rad, MOST_N), MOST_N, atol=1e-6)
    assert (pressing_N(-0.05 * apart_rad, MOST_N) < forces.normal_N).all()


def test_a_tip_that_is_pressed_in_further_does_not_pull_at_the_stiffness(wide):
    """By 0.5 mm: where the skin is that far inside, the torques are those of the forces alone."""
    gains, hand = wide
    grip = grip_at(hand.pose(Q_RAD))
    hold, J = joint_hold(Q_RAD, FRICTION, gains, 0.01), skin_jacobian_m(hand, grip)
    pose = hand.pose(Q_RAD - np.linalg.solve(J, (0.5e-3 * grip.normal).ravel()))

    def torque_Nm(deeper_m):
        return hold.torque_Nm(pose, STILL, grip, forces_on(grip), MOST_N, gains, np.full(3, deeper_m))

    free = replace(hold, stiffness_Nm_rad=np.zeros(9))
    expected = free.torque_Nm(pose, STILL, grip, forces_on(grip), MOST_N, gains, UNCHANGED_M)
    np.testing.assert_allclose(torque_Nm(0.5e-3), expected, atol=1e-3)
    assert np.abs(torque_Nm(0.0) - expected).max() > 0.01
