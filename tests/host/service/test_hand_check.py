"""hand.toml against the nodes: what each object must be, node by node, on the devices' own cores."""

import msgspec
import numpy as np
import pytest
from tests.host.axes_hand import with_axes

from palpate_host.config.control_config import ControlMode, ForceLaw
from palpate_host.service.hand_check import check_nodes, joint_angles, problem_count, table
from palpate_host.view.hand_picture import draw_hand


@pytest.fixture
def nodes(bench, table_4):
    return nodes_of(bench, *table_4)


def nodes_of(bench, config, hand):
    """Read of the slaves themselves; `changed` objects answer otherwise."""
    rig = bench.VirtualBench(config, hand)
    slaves = {node.slave.node_id: node.slave for node in (*rig.drives, *rig.tips)}
    rig.run(0.02)
    changed = {}

    def read(node_id, _device, key):
        if (node_id, key) in changed:
            return changed[node_id, key]
        value = slaves[node_id].read(*key)
        if isinstance(value, str):
            return int.from_bytes(value.encode(), "little")
        return value if value >= 0 else value + (1 << 32)

    return config, read, changed


def problems(nodes, config=None, silent=()):
    reports = list(check_nodes(config or nodes[0], nodes[1], silent))
    return {report.node_id: report.problems for report in reports if report.problems}


def test_the_simulated_hand_is_right_and_its_joints_are_where_they_stand(nodes):
    reports = list(check_nodes(nodes[0], nodes[1], ()))
    assert [report.node_id for report in reports] == [0x10, 1, 2, 3, 0x11, 4, 5, 6, 0x12, 7, 8, 9]
    assert not any(report.problems for report in reports)
    q_rad, is_measured = joint_angles(nodes[0], reports)
    assert is_measured
    np.testing.assert_allclose(q_rad, np.tile([0.0, 0.348, 1.221], 3), atol=2e-3)
    assert table(reports).count(" ok") == 12


@pytest.mark.parametrize(
    ("node", "key", "value", "said"),
    [
        (1, (0x1000, 0), 0x20194, "is not a CiA 402 device (its 1000h is of CiA 404)"),
        (1, (0x1000, 0), None, "its 1000h is missing"),
        (0x10, (0x1000, 0), 0x192, "is not a CiA 404 device"),
        (2, (0x6502, 0), 1 << 8, "lacks cyclic synchronous and profile torque (6502h is 00000100h"),
        (2, (0x6076, 0), 0, "6076h is 0"),
        (2, (0x6092, 1), 0, "6092h:01 is 0"),
        (3, (0x6072, 0), 200, "is limited to 0.38 N m (6072h), torque_limit_Nm is 0.5"),
        (4, (0x1400, 5), 0, "has no deadline for RPDO 1"),
        (5, (0x6064, 0), 900_000, "outside min_rad"),
        (6, (0x1A00, 1), 0x60640010, "0x60640010 in the node, 0x60640020 in the EDS"),
        (0x11, (0x1801, 1), 0x299, "0x299 in the node, 0x40000291 in the EDS"),
        (
            0x12,
            (0x2005, 0),
            5_000_000,
            "sends its contacts by CAN FD, 5000000 bit/s, hand.toml has classic CAN: set the same",
        ),
        (0x11, (0x100A, 0), int.from_bytes(b"0.0.9", "little"), "100Ah:00 is '0.0.9', expected '0.1.0'"),
        (0x11, (0x1018, 3), 0x20000, "1018h:03 is 0x20000, expected 0x10000: correct fingertip_node"),
    ],
)
def test_what_is_wrong_is_named_with_its_node(nodes, node, key, value, said):
    nodes[2][node, key] = value
    (found,) = problems(nodes).items()
    assert found[0] == node and any(said in problem for problem in found[1])


def test_another_fingertip_than_the_file_names_is_reported(nodes):
    config = nodes[0]
    first = msgspec.structs.replace(config.fingers[0], calibration="0123456789abcdef", serial=0x2B)
    config = msgspec.structs.replace(config, fingers=(first, *config.fingers[1:]))
    serial, calibration = problems(nodes, config)[0x10]
    assert serial.startswith("1018h:04 is 0x0, expected 0x2B")
    assert calibration.startswith(f"2001h:00 is '{'0' * 16}', expected '0123456789abcdef'")


def test_a_negative_angle_is_read_as_one(nodes):
    """6064h is INTEGER32; SDO gives its bytes."""
    assert problems(nodes) == {}
    nodes[2][1, (0x6064, 0)] = (1 << 32) - 1000
    assert problems(nodes) == {}


def test_a_silent_node_is_missing(nodes):
    assert "does not answer" in problems(nodes, silent=(7,))[7][0]


def test_the_offset_of_a_joint_counts(nodes):
    fingers = list(nodes[0].fingers)
    joints = list(fingers[0].joints)
    joints[2] = msgspec.structs.replace(joints[2], zero_offset_rad=1.0)
    fingers[0] = msgspec.structs.replace(fingers[0], joints=tuple(joints))
    config = msgspec.structs.replace(nodes[0], fingers=tuple(fingers))
    assert "is at 2.2" in problems(nodes, config)[3][0]


def test_the_hand_is_drawn_with_its_nodes(nodes, tmp_path):
    draw_hand(nodes[0], np.tile([0.0, 0.348, 1.221], 3), tmp_path / "hand.svg", "as it stands")
    assert (tmp_path / "hand.svg").read_text().count("<path") > 30


def test_what_a_fingertip_never_gives_is_named_before_the_hand_starts(nodes):
    config, _, changed = nodes
    changed |= {(0x10, (0x2000, 0)): 2, (0x10, (0x2004, 0)): 0x18}
    no_place, no_force = problems(nodes)[0x10]
    assert no_place.startswith("gives no contact place") and no_force.startswith("gives no contact force")
    boundless = msgspec.structs.replace(config.limits, contact_force_N=float("inf"))
    assert problems(nodes, msgspec.structs.replace(config, limits=boundless)) == {0x10: (no_place,)}
    blind = msgspec.structs.replace(config.control, mode=ControlMode.BLIND)
    assert problems(nodes, msgspec.structs.replace(config, control=blind)) == {}
    regulated = msgspec.structs.replace(config.control, force_law=ForceLaw.ADMITTANCE)
    found = problems(nodes, msgspec.structs.replace(config, control=regulated))[0x10]
    assert found[2].startswith(
        'gives no force at a known place, which control.force_law = "admittance" needs'
    )


def test_a_pdo_that_the_eds_disables_may_be_enabled(nodes):
    nodes[2][0x10, (0x1805, 1)] = 0x4000_01B0
    assert problems(nodes) == {}
    nodes[2][0x10, (0x1805, 1)] = 0x4000_01B1
    assert "1805h:01" in problems(nodes)[0x10][0]


def test_poses_need_the_identifiers_of_another_node_id(nodes):
    """Those of 0x30 for 0x10."""
    config, read, changed = nodes
    changed |= {(0x10, (0x2000, 0)): 2}
    fingers = list(config.fingers)
    joints = (msgspec.structs.replace(fingers[0].joints[0], drive_node=0x30), *fingers[0].joints[1:])
    fingers[0] = msgspec.structs.replace(fingers[0], joints=joints)
    config = msgspec.structs.replace(config, fingers=tuple(fingers))
    assert "of node 0x30, which is in the hand" in problems((config, read), silent={0x30})[0x10][0]


@pytest.fixture
def axes_nodes(bench, table_4):
    """A hand whose fingers have one drive node each."""
    return nodes_of(bench, with_axes(table_4[0]), table_4[1])


def test_a_hand_with_axes_is_right_and_each_joint_has_its_angle(axes_nodes):
    reports = list(check_nodes(axes_nodes[0], axes_nodes[1], ()))
    assert [report.node_id for report in reports] == [0x10, 1, 1, 1, 0x11, 2, 2, 2, 0x12, 3, 3, 3]
    assert not any(report.problems for report in reports)
    q_rad, is_measured = joint_angles(axes_nodes[0], reports)
    assert is_measured
    np.testing.assert_allclose(q_rad, np.tile([0.0, 0.348, 1.221], 3), atol=2e-3)


@pytest.mark.parametrize(
    ("key", "value", "joint", "said"),
    [
        (
            (0x6502 + 0x800, 0),
            0,
            "flexion_2",
            "lacks cyclic synchronous and profile torque (6502h is 0000",
        ),
        ((0x6072 + 0x1000, 0), 200, "curl_2", "is limited to 0.38 N m (6072h)"),
        ((0x6064 + 0x1000, 0), 900_000, "curl_2", "outside min_rad"),
        ((0x1800, 1), 0x199, "abduction_2", "0x199, expected 0x40000182: restart the drive's node"),
        ((0x1000, 0), 0x20194, "flexion_2", "is not a CiA 402 device"),
    ],
)
def test_what_is_wrong_with_an_axis_is_named_with_its_joint(axes_nodes, key, value, joint, said):
    axes_nodes[2][2, key] = value
    reports = list(check_nodes(axes_nodes[0], axes_nodes[1], ()))
    found = {report.who: report.problems for report in reports if report.problems}
    assert problem_count(reports) == "1 of 6 nodes have problems"
    assert any(said in problem for problem in found[f"drive of {joint}"])
