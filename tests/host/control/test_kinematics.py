"""The Table 4 hand: MuJoCo's answers against closed-form kinematics and finite differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.common.errors import ConfigError
from palpate_host.control.hand_model import compiled, read_spec
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.virtual_frame import check_numbering

BASE_RADIUS_M = 0.162
LINKS_M = (0.052, 0.050, 0.085)
MASSES_KG = (0.060, 0.050, 0.080)
CENTRES_OF_MASS_M = (0.026, 0.025, 0.060)
GRAVITY = 9.81

joint_angles = st.lists(st.floats(-0.5, 1.2), min_size=9, max_size=9).map(np.array)


def turn(axis, angle):
    """Rotation about x, y or z, written out."""
    c, s = np.cos(angle), np.sin(angle)
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]),
    }[axis]


def finger(q, number):
    """Positions of the three links' centres of mass, the tip's centre and its rotation, in closed form."""
    azimuth = 2 * np.pi * number / 3
    place = BASE_RADIUS_M * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    rotation = turn("z", azimuth + np.pi)
    masses = []
    for axis, angle, length, centre in zip("xyy", q, LINKS_M, CENTRES_OF_MASS_M, strict=True):
        rotation = rotation @ turn(axis, angle)
        masses.append(place + rotation @ [0, 0, centre])
        place = place + rotation @ [0, 0, length]
    return masses, place, rotation


def potential_J(q):
    heights = [mass[2] for i in range(3) for mass in finger(q[3 * i : 3 * i + 3], i)[0]]
    return GRAVITY * float(np.dot(np.tile(MASSES_KG, 3), heights))


def derivative(function, q, step=1e-6):
    columns = []
    for k in range(len(q)):
        shift = np.zeros(len(q))
        shift[k] = step
        columns.append((np.asarray(function(q + shift)) - np.asarray(function(q - shift))) / (2 * step))
    return np.stack(columns, axis=-1)


@settings(max_examples=30, deadline=None)
@given(joint_angles)
def test_pose_is_the_closed_form(table_4, q):
    pose = table_4[1].pose(q)
    for i in range(3):
        _, centre, rotation = finger(q[3 * i : 3 * i + 3], i)
        np.testing.assert_allclose(pose.tip_centre_m[i], centre, atol=1e-9)
        np.testing.assert_allclose(pose.tip_rotation[i], rotation, atol=1e-8)


@settings(max_examples=15, deadline=None)
@given(joint_angles)
def test_jacobian_and_gravity_are_derivatives(table_4, q):
    pose = table_4[1].pose(q)
    numeric = derivative(lambda p: [finger(p[3 * i : 3 * i + 3], i)[1] for i in range(3)], q)
    np.testing.assert_allclose(pose.tip_jacobian_m, numeric, atol=1e-7)
    np.testing.assert_allclose(pose.gravity_Nm, derivative(potential_J, q), atol=1e-7)


def test_start_pose_meets_a_30_mm_object(table_4):
    pose = table_4[1].pose(np.tile([0.0, 0.348, 1.221], 3))
    reach = np.linalg.norm(pose.tip_centre_m[:, :2], axis=1)
    np.testing.assert_allclose(reach - 0.030, 0.030, atol=2e-4)
    # The apex of every dome looks at the hand's axis.
    inwards = -pose.tip_centre_m[:, :2] / reach[:, None]
    np.testing.assert_allclose(pose.tip_rotation[:, :2, 2], inwards, atol=1e-3)
    check_numbering(pose.tip_centre_m)


def test_one_call_leaves_nothing_for_the_next(table_4):
    hand = table_4[1]
    first = hand.pose(np.zeros(9))
    kept = first.tip_centre_m.copy()
    hand.pose(np.full(9, 0.4))
    np.testing.assert_array_equal(first.tip_centre_m, kept)
    np.testing.assert_array_equal(hand.pose(np.zeros(9)).tip_centre_m, kept)


@pytest.mark.parametrize(
    ("text", "joints", "sites", "says"),
    [
        ("<mujoco", [], [], "not a readable MJCF"),
        ("<mujoco/>", ["curl_1"], [], "has no joint 'curl_1'; it has no joints"),
        ("<mujoco/>", [], ["tip_1"], "has no site 'tip_1'; it has no sites"),
    ],
)
def test_refusals_name_file_and_thing(tmp_path, text, joints, sites, says):
    mjcf = tmp_path / "hand.xml"
    mjcf.write_text(text)
    with pytest.raises(ConfigError, match=says) as caught:
        HandKinematics(compiled(read_spec(str(mjcf), ()), str(mjcf)), joints, sites, str(mjcf))
    assert str(mjcf) in str(caught.value) and "\n" not in str(caught.value)


def test_a_joint_left_out_is_refused(table_4, tmp_path):
    mjcf = tmp_path / "hand.xml"
    mjcf.write_text('<mujoco><worldbody><body><joint name="a"/><geom size="1"/></body></worldbody></mujoco>')
    with pytest.raises(ConfigError, match=r"1 degrees of freedom, hand\.toml has 0 joints"):
        HandKinematics(compiled(read_spec(str(mjcf), ()), str(mjcf)), [], [], str(mjcf))


def test_a_tip_that_a_urdf_lacks_is_refused_with_its_links(tmp_path):
    links = "".join(
        f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0"'
        ' iyz="0"/></inertial></link>'
        for name in ("palm", "l1", "tip1")
    )
    joints = "".join(
        f'<joint name="{child}_joint" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'
        for parent, child in (("palm", "l1"), ("l1", "tip1"))
    )
    path = tmp_path / "myhand.urdf"
    path.write_text(f'<robot name="hand">{links}{joints}</robot>')
    spec = read_spec(str(path), ("tip1", "tip9"))
    with pytest.raises(ConfigError, match=r"myhand\.urdf has no link 'tip9'; its links: .*l1, tip1: "):
        HandKinematics(compiled(spec, str(path)), [], ["tip1", "tip9"], str(path))
