"""The pose law: Jacobians and damping at the contacts, stable gains, what it holds and when."""

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.mode import Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.packaged import MODELS
from palpate_host.control.holding.stable_stiffness import contact_jacobian_m, object_damping
from palpate_host.control.holding.virtual_object import grip_of
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.object_orientation import contact_normal
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand

HAND = MODELS / "table4-wide.toml"
START_RAD = np.tile([0.0, 0.1405, 1.4285], 3)
STILL = np.zeros(9)
APEX = (0.0, 0.0, 30.0)


@pytest.fixture(scope="module")
def wide():
    return load_hand(HAND)


def apex_grip(pose):
    normal = np.array([contact_normal(pose, finger, APEX) for finger in range(3)])
    return grip_of(pose.tip_centre_m, normal, np.full((3, 1), 0.03))


def touch(exposed_at_us, position_mm=APEX):
    return TipContact(
        received_at_us=exposed_at_us,
        exposed_at_us=exposed_at_us,
        sequence=0,
        latency_us=0,
        position_mm=position_mm,
        normal_force_N=1.0,
        shear_N=(0.0, 0.0),
        torsion_Nmm=0.0,
        valid=True,
        in_contact=position_mm is not None,
        slip=False,
        quality=255,
    )


def controller(wide, pose, tick_Hz=100, **pose_law):
    """A controller under the pose law that has five contacts of every finger."""
    config, _ = wide
    config = msgspec.structs.replace(
        config,
        control=msgspec.structs.replace(config.control, law=ControlLaw.POSE, tick_Hz=tick_Hz),
        pose_law=msgspec.structs.replace(config.pose_law, **pose_law),
        target=msgspec.structs.replace(config.target, rpy_deg=(0.0, 0.0, 0.0)),
    )
    manipulation = Manipulation(config)
    for frame in range(5):
        for finger in range(3):
            manipulation.add_contact(finger, touch(frame * 33_333), pose)
    return manipulation


def tick(manipulation, pose, mode=Mode.MANIPULATE, tick_s=0.01):
    return manipulation.torque_Nm(mode, pose, STILL, virtual_frame(pose.tip_centre_m), tick_s)


def test_the_contacts_jacobian_is_the_motion_of_the_skin(wide):
    """Against central differences of a point that is fixed in the tip."""
    hand = wide[1]
    q = START_RAD + np.linspace(-0.1, 0.1, 9)
    pose = hand.pose(q)
    grip = apex_grip(pose)
    in_tip = np.einsum("iba,ib->ia", pose.tip_rotation, grip.to_contact_m)

    def skin(q):
        there = hand.pose(q)
        return there.tip_centre_m + np.einsum("iab,ib->ia", there.tip_rotation, in_tip)

    step = 1e-6
    numeric = np.stack([(skin(q + step * e) - skin(q - step * e)) / (2 * step) for e in np.eye(9)], axis=2)
    np.testing.assert_allclose(contact_jacobian_m(pose, grip), numeric, atol=1e-8)


def test_the_damping_of_the_object_dissipates_what_the_joints_do(wide):
    """q' follows from the object's velocity by rolling, since each finger has three joints: q'^T B q'."""
    config, hand = wide
    pose = hand.pose(START_RAD + np.linspace(-0.05, 0.05, 9))
    grip = apex_grip(pose)
    B = np.array([joint.B_Nms_rad for joint in config.joints])
    D = object_damping(pose, grip, B)
    J = contact_jacobian_m(pose, grip).reshape(9, 9)
    rng = np.random.default_rng(0)
    for _ in range(5):
        velocity, spin = rng.normal(size=3), rng.normal(size=3)
        qdot = np.linalg.solve(J, (velocity + np.cross(spin, grip.arm_m)).ravel())
        twist = np.concatenate((velocity, spin))
        assert twist @ D @ twist == pytest.approx(qdot @ (B * qdot))


@pytest.mark.parametrize("tick_Hz", [50, 100, 1000])
def test_the_stiffness_leaves_a_gain_margin_of_three_at_every_rate(wide, tick_Hz):
    """K <= 0.5 D/T with T = 2 ticks; never above the configured stiffness."""
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose, tick_Hz)
    tick(manipulation, pose, tick_s=1 / tick_Hz)
    used = manipulation.pose_law.stiffness
    B = np.array([joint.B_Nms_rad for joint in wide[0].joints])
    D = object_damping(pose, manipulation.pose_law.object.grip, B)
    bound = 0.5 * tick_Hz / 2
    assert np.linalg.eigvalsh(used.K_p_N_m)[-1] <= 1000.0 + 1e-6
    assert np.linalg.eigvalsh(bound * D[:3, :3] - used.K_p_N_m)[0] > -1e-6
    assert np.linalg.eigvalsh(bound * D[3:, 3:] - used.K_o_Nm_rad)[0] > -1e-6
    assert min(used.margin_p, used.margin_o) > 3.0


def test_the_law_begins_in_manipulate_and_after_settling_in_grasp(wide):
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose)
    for _ in range(45):  # of settle_ms = 500
        tick(manipulation, pose, Mode.GRASP)
    assert manipulation.pose_law.object is None
    for _ in range(10):
        tick(manipulation, pose, Mode.GRASP)
    assert manipulation.pose_law.object is not None
    tick(manipulation, pose, Mode.READY)
    assert manipulation.pose_law.object is None
    tick(manipulation, pose, Mode.MANIPULATE)
    assert manipulation.pose_law.object is not None


def firmly_held(manipulation, pose):
    """The torques once the grip of HOLD is firm."""
    for _ in range(99):
        tick(manipulation, pose, Mode.HOLD)
    return tick(manipulation, pose, Mode.HOLD)


def test_hold_keeps_the_torques_and_the_law_goes_on_with_the_same_load(wide):
    """The law is away from its target: HOLD begins with its last torques, and contacts change nothing."""
    hand = wide[1]
    manipulation = controller(wide, hand.pose(START_RAD))
    tick(manipulation, hand.pose(START_RAD))
    moved = hand.pose(START_RAD + np.tile([0.0, 0.0, -0.02], 3))
    for _ in range(50):
        last = tick(manipulation, moved)
    law = manipulation.pose_law
    lifted_m = law.object.place_m - law.target.place_m
    carried_N = law.load_N - law.stiffness.K_p_N_m @ lifted_m
    np.testing.assert_allclose(tick(manipulation, moved, Mode.HOLD), last, atol=0.02)
    grip_N = law.grip_N
    held = firmly_held(manipulation, moved)
    assert law.grip_N == min(2.0 * grip_N, 5.0)  # half of most_grip_N
    with pytest.raises(
        CommandError, match="move is refused: contacts are too old; wait until the hand leaves"
    ):
        manipulation.move((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.0)
    manipulation.add_contact(0, touch(900_000, (0.0, 10.0, 28.3)), moved)
    manipulation.add_contact(1, touch(900_000, None), moved)
    np.testing.assert_allclose(tick(manipulation, moved, Mode.HOLD), held, atol=1e-12)
    np.testing.assert_allclose(law.load_N, carried_N, atol=1e-9)
    # Joints of a hand follow the tips' indentation; these stand still and pull at the stiffness.
    np.testing.assert_allclose(tick(manipulation, moved), held, atol=0.04)
    np.testing.assert_allclose(law.load_N, carried_N, atol=1e-9)
    held = firmly_held(manipulation, moved)
    for number in range(6):
        slips = replace(touch(900_000 + number * 33_333), shear_N=(0.2, 0.0), slip=number == 5)
        manipulation.add_contact(2, slips, moved)
    assert manipulation.friction.tips[2].slips == 1
    np.testing.assert_allclose(tick(manipulation, moved, Mode.HOLD), held, atol=1e-12)


def test_a_displaced_object_is_pulled_back_and_the_load_is_learned(wide):
    """Joints that give way upwards: the torques push down, more and more, and stay within their limits."""
    hand = wide[1]
    pose = hand.pose(START_RAD)
    manipulation = controller(wide, pose)
    at_rest = tick(manipulation, pose)
    moved = hand.pose(START_RAD + np.tile([0.0, 0.0, -0.02], 3))  # the tips rise
    torques = [tick(manipulation, moved) for _ in range(50)]
    lifted_m = manipulation.pose_law.object.place_m[2] - manipulation.pose_law.target.place_m[2]
    assert 0.5e-3 < lifted_m < 3e-3
    down = [(torque - at_rest).reshape(3, 3)[:, 2].sum() for torque in torques]
    assert 0.0 < down[1] < down[-1]
    assert manipulation.pose_law.load_N[2] < -0.1
    assert (np.abs(torques) <= 0.5).all()


def test_the_force_on_an_object_is_bounded(wide):
    """However far the object is from its target, load and grip stay within what friction holds."""
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose, most_grip_N=5.0)
    tick(manipulation, pose)
    law = manipulation.pose_law
    law.target.shift(np.array([0.0, 0.0, 0.5]))
    for _ in range(100):
        tick(manipulation, pose)
    assert np.linalg.norm(law.load_N) <= 0.4 * 3 * 5.0 + 1e-9
    assert 4.9 < law.grip_N <= 5.0


def test_a_false_frame_without_contact_changes_nothing(wide):
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose)
    before = tick(manipulation, pose)
    manipulation.add_contact(1, touch(200_000, None), pose)
    manipulation.add_contact(1, touch(233_333), pose)
    np.testing.assert_allclose(tick(manipulation, pose), before, atol=1e-9)


def test_a_move_ramps_the_target_from_where_it_was(wide):
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose)
    with pytest.raises(CommandError, match="not held yet"):
        manipulation.move((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 1.0)
    tick(manipulation, pose)
    law = manipulation.pose_law
    start = law.target.place_m

    def moved_mm(ticks):
        for _ in range(ticks):
            tick(manipulation, pose)
        return 1e3 * (law.target.place_m - start)

    manipulation.move((0.0, 0.0, 10.0), (0.0, 0.0, 20.0), 1.0)
    np.testing.assert_allclose(moved_mm(50), [0.0, 0.0, 5.0], atol=1e-9)
    assert rotation.angle_deg(law.target.R @ law.object.R.T) == pytest.approx(10.0, abs=1e-6)
    manipulation.move((4.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0)  # from the middle of the ramp
    np.testing.assert_allclose(moved_mm(150), [4.0, 0.0, 5.0], atol=1e-9)
    manipulation.turn((0.0, 0.0, 5.0), 0.5)
    np.testing.assert_allclose(moved_mm(10), [4.0, 0.0, 5.0], atol=1e-9)
    manipulation.stop_turning()
    np.testing.assert_allclose(law.target.place_m, law.object.place_m)


@pytest.mark.parametrize(
    ("xyz_mm", "rpy_deg", "reason"),
    [
        ((0.0, 15.0, 15.0), (0.0, 0.0, 0.0), r"21.2 mm from where the hold began, pose_law.reach_mm is 20"),
        ((0.0, 0.0, 0.0), (0.0, 46.0, 0.0), r"46.0 deg from where the hold began, pose_law.reach_deg is 45"),
    ],
)
def test_a_target_beyond_the_workspace_is_refused_and_changes_nothing(wide, xyz_mm, rpy_deg, reason):
    pose = wide[1].pose(START_RAD)
    manipulation = controller(wide, pose)
    tick(manipulation, pose)
    before = manipulation.pose_law.target.place_m, manipulation.turned
    with pytest.raises(CommandError, match=reason):
        manipulation.move(xyz_mm, rpy_deg, 1.0)
    assert (manipulation.pose_law.target.place_m is before[0], manipulation.turned) == (True, before[1])


def test_the_papers_law_has_no_place_to_move_to(wide):
    with pytest.raises(CommandError, match=r"needs control.law = 'pose'"):
        Manipulation(wide[0]).move((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.0)


@pytest.mark.parametrize(
    "change",
    [
        ('mode = "proposed"', 'mode = "blind"'),
        ("velocity_joints = false", "velocity_joints = true"),
        ('force_law = "open"', 'force_law = "integral"'),
    ],
)
def test_a_hand_that_cannot_follow_the_law_is_refused(tmp_path, change):
    text = HAND.read_text().replace("\n[control]\n", '\n[control]\nlaw = "pose"\n')
    path = tmp_path / "hand.toml"
    path.write_text(text)
    assert hand_reader.load(path).control.law is ControlLaw.POSE
    path.write_text(text.replace(*change))
    with pytest.raises(ConfigError, match=r"control.law = 'pose' needs"):
        hand_reader.load(path)
