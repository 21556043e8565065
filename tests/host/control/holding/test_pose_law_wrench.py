"""The wrench of the pose law against its potential, and the rules of its grip, without a controller."""

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_host.common.command import CommandError
from palpate_host.config.packaged import MODELS
from palpate_host.control.gains import gains_of
from palpate_host.control.holding.pose_law import PoseLaw
from palpate_host.control.holding.stable_stiffness import contact_jacobian_m
from palpate_host.control.object_orientation import contact_normal
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand

START_RAD = np.tile([0.0, 0.1405, 1.4285], 3)
STILL = np.zeros(9)
FRICTION = [0.9, 0.9, 0.9]
DT_S = 0.01


@pytest.fixture(scope="module")
def wide():
    return load_hand(MODELS / "table4-wide.toml")


def law_that_holds(wide, **pose_law):
    """A law that holds the object at the start pose, and that pose."""
    config, hand = wide
    pose = hand.pose(START_RAD)
    pose_config = msgspec.structs.replace(config.pose_law, **pose_law)
    law = PoseLaw(config.control, pose_config, gains_of(config), 3)
    R_vir = virtual_frame(pose.tip_centre_m)
    for frame in range(config.control.reference_frames):
        for finger in range(3):
            normal = contact_normal(pose, finger, (0.0, 0.0, 30.0))
            law.add_contact(finger, normal, pose, R_vir, 33_333 * frame)
    assert law.can_hold
    law.hold(pose, R_vir, np.eye(3), DT_S)
    return law, pose


def wrench(law, pose, torque_Nm):
    """Force and torque about the object's place that these joint torques exert on it, by the contacts'
    Jacobians: three joints a finger determine its contact force."""
    grip = law.object.grip
    J = contact_jacobian_m(pose, grip)
    free_Nm = torque_Nm - pose.gravity_Nm
    force = np.array(
        [
            np.linalg.solve(J[finger][:, 3 * finger : 3 * finger + 3].T, free_Nm[3 * finger : 3 * finger + 3])
            for finger in range(3)
        ]
    )
    arm = grip.centroid_m + grip.arm_m - law.object.place_m
    return force.sum(axis=0), np.cross(arm, force).sum(axis=0)


@pytest.mark.parametrize("axis", range(3))
def test_force_and_torque_are_the_slopes_of_the_potential(wide, axis):
    """V = e^T K_p e / 2 + p^T K_o p / 2, e = x_d - x, p = log(R_d R^T): by central differences over the
    object's pose. The integral's share of one tick is in `load_N`, which the first tick adds."""
    law, pose = law_that_holds(wide)
    shift_m, turn = 0.001 * np.eye(3)[axis], Rotation.from_rotvec(0.01 * np.eye(3)[(axis + 1) % 3])
    law.target.place_m, law.target.R = law.object.place_m + shift_m, turn.as_matrix()
    torque = law.torque_Nm(pose, STILL, FRICTION, DT_S)
    force_N, torque_Nm = wrench(law, pose, torque)
    K_p, K_o = law.stiffness.K_p_N_m, law.stiffness.K_o_Nm_rad

    def potential(moved_m, turned_rad):
        e = shift_m - moved_m
        p = (turn * Rotation.from_rotvec(turned_rad).inv()).as_rotvec()
        return 0.5 * e @ K_p @ e + 0.5 * p @ K_o @ p

    step, none = 1e-6, np.zeros(3)
    slope_N = [(potential(step * e, none) - potential(-step * e, none)) / (2 * step) for e in np.eye(3)]
    slope_Nm = [(potential(none, step * e) - potential(none, -step * e)) / (2 * step) for e in np.eye(3)]
    np.testing.assert_allclose(force_N - law.load_N, -np.array(slope_N), atol=2e-6)
    integral_Nm = np.array(law._torque_I_Nm)
    np.testing.assert_allclose(torque_Nm - integral_Nm, -np.array(slope_Nm), atol=2e-6)
    np.testing.assert_allclose(law.load_N, DT_S * law.stiffness.springs[6:9, :3] @ shift_m, atol=1e-12)
    np.testing.assert_allclose(
        integral_Nm, DT_S * law.stiffness.springs[9:, 3:] @ turn.as_rotvec(), atol=1e-9
    )
    assert law.share == 1.0 and not law.is_grip_at_limit


def test_at_its_target_the_law_only_grips(wide):
    law, pose = law_that_holds(wide)
    force_N, torque_Nm = wrench(law, pose, law.torque_Nm(pose, STILL, FRICTION, DT_S))
    np.testing.assert_allclose(force_N, 0.0, atol=1e-9)
    np.testing.assert_allclose(torque_Nm, 0.0, atol=1e-9)
    assert law.place_error_mm == law.moved_mm == law.turned_deg == 0.0


def test_a_load_is_carried_at_the_target(wide):
    law, pose = law_that_holds(wide)
    law._force_I_N = (0.1, -0.2, 0.9)
    force_N, torque_Nm = wrench(law, pose, law.torque_Nm(pose, STILL, FRICTION, DT_S))
    np.testing.assert_allclose(force_N, [0.1, -0.2, 0.9], atol=1e-9)
    np.testing.assert_allclose(torque_Nm, 0.0, atol=1e-9)


def test_damping_opposes_a_steady_motion(wide):
    """After many ticks of the same velocity the filter has passed it: F = -D_p v beside the integral."""
    law, pose = law_that_holds(wide)
    velocity, spin = np.array([0.01, -0.02, 0.015]), np.array([0.1, 0.05, -0.2])
    law.object.twist = np.concatenate([velocity, spin])
    for _ in range(30):
        torque = law.torque_Nm(pose, STILL, FRICTION, DT_S)
    force_N, torque_Nm = wrench(law, pose, torque)
    np.testing.assert_allclose(force_N, -law.stiffness.dampers[:3, :3] @ velocity, atol=1e-6)
    np.testing.assert_allclose(torque_Nm, -law.stiffness.dampers[3:, 3:] @ spin, atol=1e-6)


def test_a_rest_takes_what_pulls_as_the_load(wide):
    law, _ = law_that_holds(wide, most_grip_N=50.0)
    shift_m, turn = np.array([0.001, 0.0, -0.002]), Rotation.from_rotvec([0.0, 0.02, 0.01])
    law._force_I_N, law._torque_I_Nm = (0.0, 0.0, 0.5), (0.01, 0.0, 0.0)
    law.target.place_m, law.target.R = law.object.place_m + shift_m, turn.as_matrix()
    grip_N = law.grip_N
    law.rest(FRICTION)
    np.testing.assert_allclose(
        law.load_N, law.stiffness.K_p_N_m @ shift_m + np.array([0.0, 0.0, 0.5]), atol=1e-12
    )
    pulled_Nm = law.stiffness.K_o_Nm_rad @ turn.as_rotvec()
    np.testing.assert_allclose(law._torque_I_Nm, pulled_Nm + np.array([0.01, 0.0, 0.0]), atol=1e-9)
    np.testing.assert_array_equal(law.target.place_m, law.object.place_m)
    np.testing.assert_array_equal(law.target.R, law.object.R)
    for tick in range(1, 30):
        law.still_forces(FRICTION, DT_S)
        assert law.grip_N == pytest.approx(min(grip_N * (1.0 + 2.0 * DT_S * tick), 2.0 * grip_N))
    for _ in range(60):
        forces = law.still_forces(FRICTION, DT_S)
    assert law.grip_N == pytest.approx(2.0 * grip_N)
    np.testing.assert_allclose(forces.force_N.sum(axis=0), law.load_N, atol=1e-9)
    assert (law.deeper_m > 0.0).all()  # a firmer grip presses the tips in


@pytest.mark.parametrize(
    ("reserve", "pace"), [(0.021, 1), (0.02, 0), (0.001, 0), (0.0, -1), (-0.1, -1), (np.inf, 1)]
)
def test_the_pace_of_a_turn_follows_the_reserve(wide, reserve, pace):
    law, _ = law_that_holds(wide)
    law.reserve = reserve
    assert law.pace == pace


def test_the_smallest_grip_doubles_slowly_while_the_hold_is_firm_within_half_of_the_most(wide):
    law, _ = law_that_holds(wide, most_grip_N=50.0)
    least_N = law.grip_N
    assert law._least_now_N(DT_S) == pytest.approx(least_N)
    law.is_firm = True
    assert [law._least_now_N(0.1) for _ in range(6)] == pytest.approx(
        [1.2 * least_N, 1.4 * least_N, 1.6 * least_N, 1.8 * least_N, 2.0 * least_N, 2.0 * least_N]
    )
    law.is_firm = False
    assert law._least_now_N(0.25) == pytest.approx(1.5 * least_N)
    narrow, _ = law_that_holds(wide, most_grip_N=3.0 * least_N)
    narrow.is_firm = True
    assert narrow._least_now_N(10.0) == pytest.approx(1.5 * least_N)
    weak, _ = law_that_holds(wide, most_grip_N=0.5 * least_N)
    weak.is_firm = True
    assert weak._least_now_N(10.0) == weak.most_grip_N == pytest.approx(least_N)


def test_a_slip_is_answered_by_half_more_grip_up_to_the_most(wide):
    law, _ = law_that_holds(wide)
    start_N = law.grip_N
    law.squeeze(0, 0.0)  # no grip holds a tip without friction
    assert law.grip_N == start_N
    law.squeeze(0, 0.9)
    assert law.grip_N == pytest.approx(1.5 * start_N)
    for _ in range(20):
        law.squeeze(0, 0.9)
    assert law.grip_N == pytest.approx(law.most_grip_N)


def test_a_load_is_known_after_0_3_s_below_0_15_N_and_unknown_above_0_4_N(wide):
    law, _ = law_that_holds(wide)
    for _ in range(29):
        law._note_pull(0.149, DT_S)
    assert not law.is_load_known
    law._note_pull(0.151, DT_S)
    for _ in range(31):
        law._note_pull(0.149, DT_S)
    assert law.is_load_known
    law._note_pull(0.39, DT_S)
    assert law.is_load_known
    law._note_pull(0.41, DT_S)
    assert not law.is_load_known


def test_tips_are_pressed_in_by_the_root_of_force_over_stiffness(wide):
    """Eq. (8): N = k d^2, d at most half of the radius."""
    law, _ = law_that_holds(wide)
    k, radius_m = law._config.tip_stiffness_N_m2, law._gains.tip_radius_m
    force_N = np.array([0.0, -1.0, 4.0])
    np.testing.assert_allclose(law._radius_m(force_N), radius_m - np.sqrt([0.0, 0.0, 4.0 / k]))
    assert law._radius_m(np.array([1e9]))[0] == 0.5 * radius_m
    rigid, _ = law_that_holds(wide, tip_stiffness_N_m2=0.0)
    np.testing.assert_array_equal(rigid._radius_m(force_N), radius_m)


@pytest.mark.parametrize(
    ("shift_mm", "turn_deg", "reason"),
    [(20.1, 0.0, "20.1 mm from where"), (0.0, 45.1, "45.1 deg from where"), (19.9, 44.9, "")],
)
def test_the_workspace_is_about_the_place_where_the_hold_began(wide, shift_mm, turn_deg, reason):
    law, _ = law_that_holds(wide, reach_mm=20.0, reach_deg=45.0)
    turn = Rotation.from_euler("x", turn_deg, degrees=True).as_matrix()
    shift_m = np.array([0.0, 1e-3 * shift_mm, 0.0])
    if not reason:
        law.reachable_target(shift_m, turn)
        return
    with pytest.raises(CommandError, match=reason):
        law.reachable_target(shift_m, turn)


def test_another_point_of_the_object_is_followed_from_where_it_is(wide):
    law, _ = law_that_holds(wide)
    law.target.origin_m = law.target.origin_m - np.array([0.003, 0.0, 0.0])  # the object was moved by 3 mm
    other_m = law.object.place_m + np.array([0.0, 0.01, 0.02])
    law.follow_point(other_m)
    assert law.moved_mm == pytest.approx(3.0)
    assert law.place_error_mm == 0.0
    law.target.shift(np.array([0.0, 0.0, 0.004]))
    law.target.follow_shift(0.25)
    np.testing.assert_allclose(law.target.place_m, other_m + np.array([0.0, 0.0, 0.001]))


def test_a_hold_begins_with_the_grip_of_the_grasp_and_without_a_history(wide):
    """Eqs. (10)-(11): f_d/(n r) times the distance of each tip from their centroid, on average."""
    law, pose = law_that_holds(wide)
    control = wide[0].control
    lever_m = np.linalg.norm(pose.tip_centre_m - pose.tip_centre_m.mean(axis=0), axis=1)
    assert law.grip_N == pytest.approx(control.f_d_N / (3 * control.tip_radius_m) * lever_m.mean())
    law.is_firm, law.is_load_known = True, True
    law._least_now_N(10.0)
    law._force_I_N = np.array([0.0, 0.0, 1.0])
    law.drop()
    assert law.object is None and not law.load_N.any() and law.place_error_mm is None
    law.hold(pose, virtual_frame(pose.tip_centre_m), np.eye(3), DT_S)
    assert not law.is_firm and not law.is_load_known
    assert law._least_now_N(DT_S) == pytest.approx(law.grip_N)
    centre_m = 1e-3 * np.array(wide[0].pose_law.object_centre_mm)
    np.testing.assert_allclose(law.object.place_m, law.object.grip.centroid_m + centre_m)
    law.hold_here()
    assert law.place_error_mm == 0.0


def test_the_point_that_stays_in_place_is_the_configured_one(wide):
    """Tips that turn by 30 deg about that point leave it where it is, and carry their centroid around it."""
    law, pose = law_that_holds(wide, object_centre_mm=(0.0, 3.0, -20.0))
    found = law.object
    centre_m = found.grip.centroid_m + np.array([0.0, 0.003, -0.020])
    np.testing.assert_allclose(found.place_m, centre_m, atol=1e-12)
    for _ in range(300):
        step = Rotation.from_rotvec([np.radians(0.1), 0.0, 0.0]).as_matrix()
        pose = pose._replace(
            tip_centre_m=centre_m + (pose.tip_centre_m - centre_m) @ step.T,
            tip_rotation=step @ pose.tip_rotation,
        )
        law.advance(pose, DT_S)
    assert law.turned_deg == pytest.approx(30.0, abs=0.01)
    assert law.place_error_mm < 0.01
    turned = Rotation.from_euler("x", 30.0, degrees=True).apply([0.0, -0.003, 0.020])
    np.testing.assert_allclose(found.grip.centroid_m - centre_m, turned, atol=1e-5)
