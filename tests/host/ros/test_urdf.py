"""The URDF of a hand, read by two libraries: fingertips, masses and limits are those of the host."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from msgspec.structs import replace
from tests.host.ros.conftest import places

from palpate_host.config.hand_config import HandConfig
from palpate_host.control.hand_model import model_of
from palpate_host.control.kinematics import HandKinematics
from palpate_host.ros.message_contents import JointContent
from palpate_host.ros.transforms import HandFrames
from palpate_host.ros.urdf import urdf_of
from palpate_host.service.host import load_hand

MODELS = Path(__file__).resolve().parents[3] / "host" / "palpate_host" / "models"
STRANGER = Path(__file__).resolve().parents[1] / "stranger" / "hand.toml"
AWKWARD_FINGER = """
<body name="base_{site}" pos="0.1 0.2 0.3" quat="0.7 0.1 0.7 -0.1">
  <joint name="{0}" axis="1 0 0" pos="0.01 0.02 -0.03" ref="0.4"/>
  <joint name="{1}" axis="0 1 1" pos="0 0 0.01"/>
  <geom type="box" size="0.01 0.02 0.03" pos="0 0.01 0" mass="0.2"/>
  <body pos="0 0 0.05" euler="0 1.5707963267948966 0.3">
    <joint name="{2}" axis="0 0 1" ref="-0.2"/>
    <geom type="cylinder" size="0.01 0.02" mass="0.1"/>
    <site name="{site}" pos="0.01 0 0.04" euler="0.1 0.2 0.3"/>
  </body>
</body>
"""
"""Joints with anchors and reference angles, two on one body, a pitch of 90 degrees."""

Hand = tuple[HandConfig, HandKinematics]


def hand_of(config: HandConfig, model: Path) -> Hand:
    """The hand with another model of the same joints and tips."""
    settings = replace(config.model, mjcf=str(model))
    config = replace(config, model=settings, geometry=None)
    joints = [joint.name for joint in config.joints]
    return config, HandKinematics(model_of(config), joints, settings.tip_sites, str(model))


def awkward(folder: Path) -> Hand:
    config, _ = load_hand(MODELS / "table4.toml")
    fingers = [
        AWKWARD_FINGER.format(*(joint.name for joint in finger.joints), site=site)
        for finger, site in zip(config.fingers, config.model.tip_sites, strict=True)
    ]
    path = folder / "hand.xml"
    path.write_text(f'<mujoco><compiler angle="radian"/><worldbody>{"".join(fingers)}</worldbody></mujoco>')
    return hand_of(config, path)


@pytest.fixture(params=["table4", "table3", "stranger", "awkward"])
def a_hand(request: pytest.FixtureRequest, tmp_path: Path) -> Hand:
    if request.param == "awkward":
        return awkward(tmp_path)
    return load_hand(STRANGER if request.param == "stranger" else MODELS / f"{request.param}.toml")


def random_poses(config: HandConfig) -> np.ndarray:
    return np.random.default_rng(3).uniform(-1.0, 1.0, (5, len(config.joints)))


def test_pinocchio_finds_the_fingertips_where_the_host_has_them(a_hand: Hand) -> None:
    config, hand = a_hand
    model = pinocchio.buildModelFromXML(urdf_of(config))
    data = model.createData()
    assert model.nq == len(config.joints)
    for q_rad in random_poses(config):
        pose = hand.pose(q_rad)
        by_name = np.zeros(model.nq)
        for joint, angle in zip(config.joints, q_rad, strict=True):
            by_name[model.joints[model.getJointId(joint.name)].idx_q] = angle
        pinocchio.framesForwardKinematics(model, data, by_name)
        for tip, site in enumerate(config.model.tip_sites):
            found = data.oMf[model.getFrameId(site, pinocchio.FrameType.BODY)]
            np.testing.assert_allclose(found.translation, pose.tip_centre_m[tip], atol=1e-9)
            np.testing.assert_allclose(found.rotation, pose.tip_rotation[tip], atol=1e-8)
        gravity_Nm = pinocchio.computeGeneralizedGravity(model, data, by_name)
        in_order = [gravity_Nm[model.joints[model.getJointId(joint.name)].idx_v] for joint in config.joints]
        np.testing.assert_allclose(in_order, pose.gravity_Nm, atol=1e-6)


def test_every_frame_is_where_pinocchio_has_it(a_hand: Hand) -> None:
    config, _ = a_hand
    urdf = urdf_of(config)
    frames = HandFrames(urdf)
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    names = tuple(joint.name for joint in config.joints)
    for q_rad in random_poses(config):
        by_name = np.zeros(model.nq)
        for name, angle in zip(names, q_rad, strict=True):
            by_name[model.joints[model.getJointId(name)].idx_q] = angle
        pinocchio.framesForwardKinematics(model, data, by_name)
        (moving,) = frames.of_tick([JointContent("joint_states", 7, names, tuple(q_rad), (), ())])
        found = places((*frames.fixed(7).transforms, *moving.transforms))
        links = [frame for frame in model.frames if frame.type == pinocchio.FrameType.BODY]
        assert {frame.name for frame in links} - {"universe"} == set(found)
        for name, (position_m, rotation) in found.items():
            expected = data.oMf[model.getFrameId(name, pinocchio.FrameType.BODY)]
            np.testing.assert_allclose(position_m, expected.translation, atol=1e-9)
            np.testing.assert_allclose(rotation.as_matrix(), expected.rotation, atol=1e-9)


def test_limits_and_visuals_are_those_of_the_hand() -> None:
    config, _ = load_hand(MODELS / "table4.toml")
    text = urdf_of(config)
    model = pinocchio.buildModelFromXML(text)
    for joint in config.joints:
        place = model.joints[model.getJointId(joint.name)].idx_q
        assert model.lowerPositionLimit[place] == pytest.approx(joint.min_rad)
        assert model.upperPositionLimit[place] == pytest.approx(joint.max_rad)
        assert model.effortLimit[place] == pytest.approx(joint.torque_limit_Nm)
    keep = '<mujoco><compiler discardvisual="false"/></mujoco><link'
    read = mujoco.MjModel.from_xml_string(text.replace("<link", keep, 1))
    spheres = np.count_nonzero(read.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)
    assert spheres == 3 * (3 * 2 + 1)  # each link is drawn as a capsule, each finger has a dome
    assert read.body_mass.sum() == pytest.approx(model_of(config).body_mass.sum())


def test_a_hand_from_a_urdf_gives_the_same_again(tmp_path: Path) -> None:
    config, hand = load_hand(MODELS / "table4.toml")
    path = tmp_path / "hand.urdf"
    path.write_text(urdf_of(config))
    again_config, again = hand_of(config, path)
    for q_rad in random_poses(config):
        np.testing.assert_allclose(again.pose(q_rad).tip_centre_m, hand.pose(q_rad).tip_centre_m, atol=1e-9)
    assert urdf_of(again_config).count('<link name="tip_1"') == 1
