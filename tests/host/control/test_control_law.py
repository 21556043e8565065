"""Eqs. (9)-(11), (13), (14): the printed form, signs, limits."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate_host.control.control_law import (
    carrying_force_N,
    grasp_force_N,
    joint_torque_Nm,
    limit_torque_Nm,
    orientation_force_N,
    rotation_error,
)
from palpate_host.control.gains import Gains
from palpate_host.control.virtual_frame import FrameError, virtual_frame

WITHOUT_FRICTION_LIMIT = 1e9
GAINS = Gains(
    f_d_N=4.0,
    K_r=3.5,
    B_Nms_rad=np.full(9, 0.07),
    tip_radius_m=0.03,
    friction_ratio=WITHOUT_FRICTION_LIMIT,
    torque_limit_Nm=np.full(9, 0.5),
    q_min_rad=np.full(9, -0.5),
    q_max_rad=np.full(9, 1.8),
)
WITH_FRICTION = dataclasses.replace(GAINS, friction_ratio=0.4)

seeds = st.integers(0, 2**32 - 1)
rotations = seeds.map(lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix())
tips_m = seeds.map(lambda seed: 0.05 * np.random.default_rng(seed).normal(size=(3, 3)))
small_turns = st.tuples(*[st.floats(-0.3, 0.3)] * 3).map(np.array).filter(lambda v: np.linalg.norm(v) > 0.01)


def printed_force(tips, R_vir, R_d_vir):
    """F_di exactly as Eq. (14) prints it, axis by axis."""
    x_0 = tips.mean(axis=0)
    total = sum(np.cross(R_vir[:, k], R_d_vir[:, k]) for k in range(3))
    omega = GAINS.f_d_N / (3 * GAINS.tip_radius_m) * GAINS.K_r * total
    forces = []
    for x_c in tips:
        n = np.cross(omega, x_c - x_0)
        n /= np.linalg.norm(n)
        a = np.cross(n, omega)
        a /= np.linalg.norm(a)
        l_n = x_0 - x_c
        forces.append(np.cross((a @ l_n) * a, omega))
    return np.array(forces)


@given(tips_m, rotations, small_turns)
def test_force_is_the_printed_one_without_its_singularity(tips, R_vir, turn):
    R_d_vir = Rotation.from_rotvec(turn).as_matrix() @ R_vir
    lever = tips - tips.mean(axis=0)
    if np.min(np.linalg.norm(np.cross(turn, lever), axis=1)) < 1e-4:
        return  # the printed n_i is 0/0 here
    ours = orientation_force_N(tips, R_vir, R_d_vir, GAINS)
    np.testing.assert_allclose(ours, printed_force(tips, R_vir, R_d_vir), atol=1e-7)


@given(tips_m, rotations)
def test_zero_error_gives_zero_force(tips, R_vir):
    np.testing.assert_allclose(orientation_force_N(tips, R_vir, R_vir, GAINS), 0.0, atol=1e-12)


@given(tips_m, rotations, small_turns)
def test_the_moment_turns_towards_the_target(tips, R_vir, turn):
    R_d_vir = Rotation.from_rotvec(turn).as_matrix() @ R_vir
    lever = tips - tips.mean(axis=0)
    force = orientation_force_N(tips, R_vir, R_d_vir, WITH_FRICTION)
    moment = np.cross(lever, force).sum(axis=0)
    assert moment @ turn >= -1e-12
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-9)


@given(tips_m, small_turns)
def test_moving_the_tips_along_the_force_reduces_the_error(tips, turn):
    """Finite differences of Eq. (12) itself: a small step along F_di brings R_vir nearer to the target."""
    try:
        R_vir = virtual_frame(tips)
    except FrameError:
        return
    if np.linalg.svd(tips - tips.mean(axis=0))[1][1] < 0.02:
        return  # nearly collinear: Eq. (12) sees other turns than the moment makes
    R_d_vir = Rotation.from_rotvec(turn).as_matrix() @ R_vir
    omega = turn / np.linalg.norm(turn)
    rigid = np.cross(omega, tips - tips.mean(axis=0))
    before = Rotation.from_matrix(R_d_vir @ R_vir.T).magnitude()
    after = Rotation.from_matrix(R_d_vir @ virtual_frame(tips + 1e-4 * rigid).T).magnitude()
    assert after < before
    # F_di is that rigid turn times a positive number.
    force = orientation_force_N(tips, R_vir, R_d_vir, GAINS)
    scale = np.sum(force * rigid) / np.sum(rigid * rigid)
    assert scale > 0.0
    np.testing.assert_allclose(force, scale * rigid, atol=1e-9)


@given(tips_m, rotations, small_turns, rotations)
def test_forces_turn_with_the_frame_they_are_written_in(tips, R_vir, turn, Q):
    R_d_vir = Rotation.from_rotvec(turn).as_matrix() @ R_vir
    here = orientation_force_N(tips, R_vir, R_d_vir, WITH_FRICTION)
    there = orientation_force_N(tips @ Q.T, Q @ R_vir, Q @ R_d_vir, WITH_FRICTION)
    np.testing.assert_allclose(there, here @ Q.T, atol=1e-9)


@pytest.mark.parametrize("degrees", [1, 30, 59.9, 60.1, 90, 135, 179, 179.999, 180])
def test_error_is_2_sin_up_to_60_degrees_and_grows_on(degrees):
    R = Rotation.from_rotvec([0, 0, np.radians(degrees)]).as_matrix()
    size = np.linalg.norm(rotation_error(np.eye(3), R))
    angle = np.radians(degrees)
    expected = 2 * np.sin(angle) if degrees <= 60 else np.sqrt(3) + angle - np.pi / 3
    assert size == pytest.approx(expected, abs=1e-6)


def test_printed_error_is_the_sum_over_the_axes():
    R = Rotation.from_rotvec([0.2, -0.3, 0.4]).as_matrix()
    expected = sum(np.cross(np.eye(3)[:, k], R[:, k]) for k in range(3))
    np.testing.assert_allclose(rotation_error(np.eye(3), R), expected, atol=1e-12)


@given(tips_m, rotations, rotations)
def test_no_finger_asks_more_than_friction_bears(tips, R_vir, R_d_vir):
    force = np.linalg.norm(orientation_force_N(tips, R_vir, R_d_vir, WITH_FRICTION), axis=1)
    grasp = np.linalg.norm(grasp_force_N(tips, WITH_FRICTION), axis=1)
    assert np.all(force <= 0.4 * grasp * (1 + 1e-9) + 1e-12)


def test_grasp_pulls_with_f_d_rho_over_3_r(table_4):
    tips = table_4[1].pose(np.tile([0.0, 0.348, 1.221], 3)).tip_centre_m
    size = np.linalg.norm(grasp_force_N(tips, GAINS), axis=1)
    np.testing.assert_allclose(size, 4.0 * 0.0599492 / (3 * 0.03), rtol=1e-5)


@given(tips_m, st.tuples(*[st.floats(-0.05, 0.05)] * 3).map(np.array))
def test_carrying_adds_up_to_weight_and_spring_and_turns_nothing(tips, hold_at):
    gains = dataclasses.replace(GAINS, object_weight_N=0.9, position_stiffness_N_m=200.0)
    force = carrying_force_N(tips, hold_at, gains)
    expected = np.array([0.0, 0.0, 0.9]) + 200.0 * (hold_at - tips.mean(axis=0))
    np.testing.assert_allclose(3 * force, expected, atol=1e-12)  # the same at each tip
    moment = np.cross(tips - tips.mean(axis=0), force).sum(axis=0)
    np.testing.assert_allclose(moment, 0.0, atol=1e-12)


def test_joint_torque_is_virtual_work(table_4):
    """Power of the torques over J^T F equals the power of the forces at the moving tips."""
    hand = table_4[1]
    q, qdot = np.tile([0.1, 0.3, 1.0], 3), np.linspace(-1, 1, 9)
    pose = hand.pose(q)
    R_vir = virtual_frame(pose.tip_centre_m)
    R_d_vir = Rotation.from_rotvec([0.0, 0.1, 0.2]).as_matrix() @ R_vir
    u = joint_torque_Nm(pose, qdot, R_vir, R_d_vir, WITH_FRICTION)
    force = grasp_force_N(pose.tip_centre_m, GAINS) + orientation_force_N(
        pose.tip_centre_m, R_vir, R_d_vir, WITH_FRICTION
    )
    ahead, behind = hand.pose(q + 1e-6 * qdot), hand.pose(q - 1e-6 * qdot)
    tip_speed = (ahead.tip_centre_m - behind.tip_centre_m) / 2e-6
    expected = np.sum(force * tip_speed) - 0.07 * qdot @ qdot + pose.gravity_Nm @ qdot
    assert u @ qdot == pytest.approx(expected, rel=1e-6)


@given(st.lists(st.floats(-5, 5), min_size=9, max_size=9), st.lists(st.floats(-2, 3), min_size=9, max_size=9))
def test_limits(u, q):
    u, q = np.array(u), np.array(q)
    limited = limit_torque_Nm(u, q, GAINS)
    assert np.all(np.abs(limited) <= 0.5)
    assert not np.any((q >= 1.8) & (limited > 0)) and not np.any((q <= -0.5) & (limited < 0))
    inside = (q > -0.5 + 0.05) & (q < 1.8 - 0.05)
    np.testing.assert_array_equal(limited[inside], np.clip(u, -0.5, 0.5)[inside])


def test_torque_outwards_fades_before_the_end_of_the_range():
    """Half of the last 0.05 rad is left: half of the limit outwards, all of it inwards."""
    near_end = np.full(9, 1.775)
    np.testing.assert_allclose(limit_torque_Nm(np.full(9, 5.0), near_end, GAINS), 0.25)
    np.testing.assert_allclose(limit_torque_Nm(np.full(9, -5.0), near_end, GAINS), -0.5)


def test_at_its_end_a_joint_takes_no_torque_outwards_though_nothing_fades_before():
    hard = dataclasses.replace(GAINS, soft_limit_rad=0.0)
    assert (limit_torque_Nm(np.full(9, 5.0), GAINS.q_max_rad, hard) == 0.0).all()
    assert (limit_torque_Nm(np.full(9, -5.0), GAINS.q_max_rad, hard) == -GAINS.torque_limit_Nm).all()
