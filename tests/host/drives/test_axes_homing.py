"""Homing of axes of one node: their frames have no mode, so the host changes it over SDO."""

from __future__ import annotations

import msgspec
import pytest
from tests.host.axes_hand import with_axes
from tests.host.homing import check_homed, homing_config, shifted

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_host.common.command import Grasp, Recover, Stop
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand
from palpate_host.common.mode import Mode
from palpate_host.config.hand_config import HomingConfig
from palpate_host.drives.cia402_axes import axes_of_node
from palpate_host.drives.drive import DriveNeeds, HomingState
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.simulated_drives import SimulatedAxes

NODE, AXES = 5, (0, 3)
TICK_US = 10_000
SYNC, START = CanFrame(0x080), CanFrame(0, bytes([1, NODE]))
SHIFTED = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.3, max_rad=0.7)
HOME, OFF = JointCommand(DriveGoal.HOME), JointCommand(DriveGoal.OFF)
MODE_OF_AXIS_3 = b"\x2f\x60\x78\x00"  # 6060h + 3 x 800h


class Node:
    """The masters of two axes and the core of their node, on a wire of their own.

    requests: SDO requests since the start. loses: how many of the next ones are lost.
    """

    def __init__(self, config, follows, homing, parameters=SHIFTED):
        self.device = SimulatedAxes(NODE, dict.fromkeys(AXES, parameters))
        control = msgspec.structs.replace(config.control, drives_follow=follows)
        needs = [
            DriveNeeds(
                NODE,
                msgspec.structs.replace(
                    config.joints[0],
                    drive_node=NODE,
                    axis=axis,
                    direction=1,
                    zero_offset_rad=0.0,
                    home_rad=-0.5,
                ),
                control,
                homing,
                AXES,
                axis == AXES[-1],
            )
            for axis in AXES
        ]
        self.drives = axes_of_node(needs)
        self.now_us, self.loses, self.requests = 0, 0, []
        self.tell([])
        for drive in self.drives:
            while not drive.is_identified:
                self.tell([drive.request(self.now_us)])
        self.tell([START])

    def tell(self, frames):
        self.now_us += 1000
        for frame in self.device.process(self.now_us, frames).frames_out:
            for drive in self.drives:
                if frame.can_id in drive.receive_ids:
                    drive.receive(self.now_us, frame)

    def run(self, duration_s, *orders):
        for _ in range(round(duration_s * 1e6 / TICK_US)):
            commands = [
                frame
                for drive, order in zip(self.drives, orders, strict=True)
                for frame in drive.command(order)
            ]
            requests = [frame for drive in self.drives if (frame := drive.request(self.now_us))]
            self.requests += requests
            lost, self.loses = min(self.loses, len(requests)), self.loses - len(requests)
            self.tell([SYNC, *commands, *requests[lost:]])
            for _ in range(9):
                self.tell([])

    def modes_written(self):
        return [frame.data[4] for frame in self.requests if frame.data[:4] == MODE_OF_AXIS_3]


@pytest.mark.parametrize("follows", list(Follows))
def test_an_axis_homes_while_the_other_is_off_and_returns_to_its_mode(table_4, follows):
    node = Node(table_4[0], follows, HomingConfig(method=17, search_rad_s=0.5))
    first, second = node.drives
    node.run(0.2, OFF, HOME)
    assert (first.homing, second.homing) == (None, HomingState.MISSING)
    node.run(1.2, OFF, HOME)
    assert (first.homing, second.homing) == (None, HomingState.ATTAINED)
    assert second.is_enabled and first.state is DriveState.SWITCH_ON_DISABLED
    still, homed = (motor.plant for motor in node.device.motors)
    assert homed.position_rad == pytest.approx(-0.3, abs=0.003)
    assert second.joint.position_rad == pytest.approx(-0.5, abs=0.003)  # home_rad
    assert still.position_rad == pytest.approx(SHIFTED.grasp_rad)
    working = {Follows.TORQUE: 10, Follows.VELOCITY: 9, Follows.POSITION: 8}[follows]
    assert node.modes_written() == [6, working]
    assert node.device.slave.read(0x7861, 0) == working
    node.run(0.3, OFF, HOME)  # homed: nothing moves again
    assert homed.position_rad == pytest.approx(-0.3, abs=0.003)


def test_a_lost_request_is_sent_again(table_4):
    node = Node(table_4[0], Follows.TORQUE, HomingConfig(method=37))
    node.loses = 1
    node.run(0.5, OFF, HOME)
    assert node.modes_written() == [6, 6, 10]
    assert node.drives[1].homing is HomingState.ATTAINED


def test_an_axis_follows_no_torque_before_its_mode_is_back(table_4):
    node = Node(table_4[0], Follows.TORQUE, HomingConfig(method=17, search_rad_s=0.05))
    node.run(0.2, OFF, HOME)
    node.loses = 1000
    node.run(0.5, OFF, JointCommand(DriveGoal.TORQUE, 0.1))
    assert node.drives[1].state is DriveState.SWITCH_ON_DISABLED
    node.loses = 0
    node.run(0.5, OFF, JointCommand(DriveGoal.TORQUE, 0.1))
    assert node.drives[1].is_enabled
    assert node.drives[1].torque_Nm == pytest.approx(0.1, abs=0.002)


def test_the_wrong_switch_is_a_homing_error(table_4):
    at_other_end = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.3, max_rad=0.0)
    node = Node(table_4[0], Follows.TORQUE, HomingConfig(method=17), at_other_end)
    node.run(0.4, OFF, HOME)
    assert node.drives[1].homing is HomingState.ERROR


def test_a_node_that_refuses_the_mode_in_operation_is_reported(table_4):
    drive = Node(table_4[0], Follows.TORQUE, HomingConfig(method=37)).drives[1]
    drive.command(HOME)
    drive.request(10_000_000)
    refusal = CanFrame(0x580 + NODE, b"\x80\x60\x78\x00\x22\x00\x00\x08")
    with pytest.raises(BusError, match=r"axis 3\) aborts the download of 7860h:00 = 6 \(abort 08000022h\)"):
        drive.receive(0, refusal)


def test_without_homing_no_mode_is_changed(table_4):
    node = Node(table_4[0], Follows.TORQUE, None)
    node.run(0.5, JointCommand(DriveGoal.TORQUE, 0.1), JointCommand(DriveGoal.TORQUE, 0.1))
    assert node.drives[0].is_enabled and node.drives[1].is_enabled
    assert node.requests == []


@pytest.fixture
def homing_hand(bench, table_4):
    """Table 4's hand with three nodes of three axes; each drive's zero is 0.2 rad off."""
    config, hand = table_4
    config = homing_config(with_axes(config))
    rig = bench.VirtualBench(config, hand)
    for motor, joint in zip((m for d in rig.drives for m in d.motors), config.joints, strict=True):
        parameters = shifted(joint)
        motor.plant.parameters = parameters
        motor.plant.position_rad = parameters.grasp_rad
    return config, rig


def test_the_host_homes_every_axis_before_it_is_ready_and_not_again_after_recover(homing_hand):
    config, rig = homing_hand
    rig.run(5.5)
    check_homed(config, rig)
    rig.core.command(Stop())
    rig.run(1.0)
    rig.drives[0].motors[0].plant.position_rad += 0.1
    rig.core.command(Recover())
    rig.run(3.0)  # each axis is asked whether it knows its zero
    assert rig.statuses[-1].mode is Mode.READY
    assert rig.statuses[-1].joints[0].position_rad > config.joints[0].min_rad + 0.05
    rig.core.command(Grasp())
    rig.run(0.5)
    assert all(joint.drive_state == "operation enabled" for joint in rig.statuses[-1].joints)
