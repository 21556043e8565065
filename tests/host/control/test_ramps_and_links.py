"""The ramp of a turn tick by tick, and a hand of known links, without contacts."""

import msgspec
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from palpate_edge.common.errors import ConfigError
from palpate_host.common.command import CommandError
from palpate_host.common.mode import Mode
from palpate_host.config.control_config import ControlMode
from palpate_host.config.geometry_config import Axis, GeometryConfig, LinkConfig
from palpate_host.config.packaged import MODELS
from palpate_host.control.hand_geometry import JointRange, hand_spec
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.manipulation import Manipulation
from palpate_host.control.virtual_frame import virtual_frame
from palpate_host.service.host import load_hand

TICK_S = 0.01
START_RAD = np.tile([0.0, 0.1405, 1.4285], 3)


@pytest.fixture(scope="module")
def table_4():
    return load_hand(MODELS / "table4.toml")


@pytest.fixture
def blind(table_4):
    """The blind law, which takes the tips' frame for the object's, and its pose."""
    config, hand = table_4
    control = msgspec.structs.replace(config.control, mode=ControlMode.BLIND, integral_per_s=0.0)
    return Manipulation(msgspec.structs.replace(config, control=control)), hand.pose(START_RAD)


def ticks(made, pose, count, mode=Mode.BLIND):
    R_vir = virtual_frame(pose.tip_centre_m)
    for _ in range(count):
        torque = made.torque_Nm(mode, pose, np.zeros(9), R_vir, TICK_S)
    return torque


def turned_deg(made, pose):
    """The rotation vector from the tips' frame to the desired orientation."""
    return (
        Rotation.from_matrix(made.R_d) * Rotation.from_matrix(virtual_frame(pose.tip_centre_m)).inv()
    ).as_rotvec(degrees=True)


def test_a_turn_advances_evenly_and_stays_at_its_end(blind):
    made, pose = blind
    made.turn((0.0, 0.0, 30.0), 2.0)
    assert made.turned == 0.0 and made.R_d is None
    for count, share in ((50, 0.25), (100, 0.75), (50, 1.0), (20, 1.0)):
        ticks(made, pose, count)
        assert made.turned == pytest.approx(share)
        np.testing.assert_allclose(turned_deg(made, pose), [0.0, 0.0, 30.0 * share], atol=1e-6)
        error_deg = made.orientation_error_deg(virtual_frame(pose.tip_centre_m))
        assert error_deg == pytest.approx(30.0 * share, abs=1e-6)


def test_a_second_turn_begins_at_the_last_target(blind):
    made, pose = blind
    made.turn((0.0, 0.0, 30.0), 1.0)
    ticks(made, pose, 50)
    made.turn((10.0, 0.0, 0.0), 0.0)  # at once
    ticks(made, pose, 1)
    both = Rotation.from_euler("x", 10.0, degrees=True) * Rotation.from_euler("z", 15.0, degrees=True)
    np.testing.assert_allclose(turned_deg(made, pose), both.as_rotvec(degrees=True), atol=1e-6)
    assert made.turned == 1.0
    made.stop_turning()
    assert made.R_d is None and made.orientation_error_deg(virtual_frame(pose.tip_centre_m)) is None


def test_only_modes_that_move_have_torques(blind):
    made, pose = blind
    assert not ticks(made, pose, 1, Mode.READY).any()
    closing, opening = ticks(made, pose, 1, Mode.GRASP), ticks(made, pose, 1, Mode.RELEASE)
    gravity = pose.gravity_Nm
    across = np.outer(closing - gravity, opening - gravity)
    np.testing.assert_allclose(across, across.T, atol=1e-12)  # along one direction
    assert (closing - gravity) @ (opening - gravity) < 0.0


def test_the_papers_law_moves_and_gaits_nothing(blind):
    made, _ = blind
    with pytest.raises(CommandError, match=r"it needs control.law = 'pose'"):
        made.move((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.0)
    with pytest.raises(CommandError, match="and a held object"):
        made.request_turn((0.0, 0.0, 90.0), ((0.0, 0.0, 0.0),) * 4)
    with pytest.raises(CommandError, match="and a held object"):
        made.start_gait(None)
    made.take_plan(None, "")  # without a request: nothing
    assert made.gait is None


LINKS = (
    LinkConfig(
        length_m=0.05, mass_kg=0.04, inertia_kgm2=(1e-5, 1e-5, 1e-6), joints=(Axis.ABDUCTION, Axis.FLEXION)
    ),
    LinkConfig(
        length_m=0.03,
        mass_kg=0.02,
        inertia_kgm2=(1e-6, 1e-6, 1e-7),
        joints=(Axis.FLEXION,),
        centre_of_mass_m=0.01,
    ),
)
AZIMUTHS_DEG = (10.0, 140.0)
GEOMETRY = GeometryConfig(base_circle_m=0.06, base_azimuth_deg=AZIMUTHS_DEG, links=LINKS)
SITES = ("tip_a", "tip_b")


def two_fingers():
    names = [[JointRange(f"{joint}{finger}", -1.0, 1.5) for joint in "abc"] for finger in range(2)]
    model = hand_spec(GEOMETRY, names, SITES, 0.02).compile()
    joints = [joint.name for finger in names for joint in finger]
    return model, HandKinematics(model, joints, SITES, "a test")


@pytest.mark.parametrize("seed", range(3))
def test_tips_are_at_the_ends_of_their_links(seed):
    """+x of a base points to the hand's axis; abduction about x, then flexion about y, links along z."""
    q_rad = np.random.default_rng(seed).uniform(-0.8, 1.2, 6)
    _, hand = two_fingers()
    pose = hand.pose(q_rad)
    for finger, azimuth_deg in enumerate(AZIMUTHS_DEG):
        abduction, flexion, second = q_rad[3 * finger : 3 * finger + 3]
        base = Rotation.from_euler("z", azimuth_deg + 180.0, degrees=True)
        first = base * Rotation.from_euler("x", abduction) * Rotation.from_euler("y", flexion)
        last = first * Rotation.from_euler("y", second)
        start = Rotation.from_euler("z", azimuth_deg, degrees=True).apply([0.06, 0.0, 0.0])
        knuckle = start + first.apply([0.0, 0.0, 0.05])
        tip = knuckle + last.apply([0.0, 0.0, 0.03])
        np.testing.assert_allclose(pose.tip_centre_m[finger], tip, atol=1e-12)
        np.testing.assert_allclose(pose.tip_rotation[finger], last.as_matrix(), atol=1e-12)
        # g(q) is the slope of the potential energy, here about the last joint alone
        arm = last.apply([0.0, 0.0, 0.01])
        axis = first.apply([0.0, 1.0, 0.0])
        assert pose.gravity_Nm[3 * finger + 2] == pytest.approx(
            0.02 * 9.81 * np.cross(axis, arm)[2], abs=1e-12
        )


def test_the_model_has_a_body_a_link_and_a_dome_for_each_finger():
    model, _ = two_fingers()
    bodies = [model.body(number).name for number in range(1, model.nbody)]
    assert bodies == ["base_1", "link_1_1", "link_1_2", "base_2", "link_2_1", "link_2_2"]
    assert model.body("link_1_1").ipos == pytest.approx([0.0, 0.0, 0.025])
    assert model.geom("tip_b_dome").size[0] == 0.02
    assert model.joint("a0").range == pytest.approx([-1.0, 1.5])
    assert model.joint("a0").axis == pytest.approx([1.0, 0.0, 0.0])
    assert model.opt.gravity == pytest.approx([0.0, 0.0, -9.81])
    assert isinstance(model, mujoco.MjModel)


@pytest.mark.parametrize(
    ("fingers", "joints", "message"),
    [(3, "abc", "has 2 angles for 3 fingers"), (2, "ab", "has 3 joints, finger 1 of .* has 2")],
)
def test_numbers_that_do_not_agree_are_refused(fingers, joints, message):
    names = [[JointRange(f"{joint}{finger}", -1.0, 1.0) for joint in joints] for finger in range(fingers)]
    with pytest.raises(ConfigError, match=message):
        hand_spec(GEOMETRY, names, [f"tip_{n}" for n in range(fingers)], 0.02)
