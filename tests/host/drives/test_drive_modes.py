"""Velocity, position and homing: the master against real drive cores, and the whole hand with such drives."""

import importlib.util
import math
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from tests.host.homing import check_homed, homing_config, shifted

from palpate_bus.eds.cia402 import DriveState
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_host.common.command import Grasp, Recover, Rotate, Stop
from palpate_host.common.joint_command import DriveGoal, Follows, JointCommand
from palpate_host.common.mode import Mode
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ForceLaw
from palpate_host.config.hand_config import HomingConfig, RunConfig, StartMode
from palpate_host.drives.cia402 import Cia402Drive
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.cia402_modes import OperationMode
from palpate_host.drives.drive import DriveNeeds, HomingState
from palpate_host.drives.joint_orders import LEAD_RAD, JointOrders
from palpate_twin.drives.drive_plant import JointParameters, JointPlant
from palpate_twin.drives.simulated_drives import PlantMotor, SimulatedDrive

TICK_US = 10_000
SYNC = CanFrame(0x080)
FREE = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.5, max_rad=0.5)
PROFILE = (OperationMode.PROFILE_POSITION, OperationMode.PROFILE_VELOCITY, OperationMode.HOMING)


def load(name):
    path = Path(__file__).parents[1] / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"palpate_{name}_modes", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def changed(config, section, **values):
    part = msgspec.structs.replace(getattr(config, section), **values)
    return msgspec.structs.replace(config, **{section: part})


class Pair:
    """A master and a drive core on a wire of their own, a tick at a time."""

    def __init__(
        self, config, follows, homing=None, modes=tuple(OperationMode), parameters=FREE, direction=1
    ):
        self.plant = JointPlant(parameters)
        self.device = Cia402Device(5, PlantMotor(self.plant), modes)
        joint = msgspec.structs.replace(
            config.joints[0], drive_node=5, direction=direction, zero_offset_rad=0.0
        )
        joint = msgspec.structs.replace(joint, home_rad=-0.5 if direction == 1 else 0.5)
        control = msgspec.structs.replace(config.control, drives_follow=follows)
        self.drive = Cia402Drive(DriveNeeds(5, joint, control, homing))
        self.now_us = 0
        self.tell([])  # the boot-up: PDOs are mapped in PRE-OPERATIONAL
        while (frame := self.drive.request(self.now_us)) is not None:
            self.tell([frame])
        self.tell([CanFrame(0, b"\x01\x05")])

    def tell(self, frames):
        self.now_us += 1000
        for frame in self.device.process(self.now_us, frames).frames_out:
            if frame.can_id in self.drive.receive_ids:
                self.drive.receive(self.now_us, frame)

    def run(self, duration_s, order):
        for _ in range(round(duration_s * 1e6 / TICK_US)):
            self.tell([SYNC, *self.drive.command(order)])
            for _ in range(9):
                self.tell([])
        return self.drive.joint


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("modes", [tuple(OperationMode), PROFILE])
def test_a_drive_turns_with_the_velocity_asked_for(table_4, modes, direction):
    pair = Pair(table_4[0], Follows.VELOCITY, modes=modes, direction=direction)
    order = JointCommand(DriveGoal.VELOCITY, 0.5, velocity_rad_s=0.4)
    pair.run(0.3, order)
    before = pair.drive.joint
    after = pair.run(0.5, order)
    assert pair.drive.state is DriveState.OPERATION_ENABLED
    turned = after.position_rad - before.position_rad
    assert turned == pytest.approx(0.4 * (after.stamp_us - before.stamp_us) * 1e-6, rel=0.01)
    assert after.velocity_rad_s == pytest.approx(0.4, rel=0.02)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("modes", [tuple(OperationMode), PROFILE])
def test_a_drive_goes_to_one_position_after_the_other(table_4, modes, direction):
    """Profile position needs its handshake for each: the second comes while the first is under way."""
    pair = Pair(table_4[0], Follows.POSITION, modes=modes, direction=direction)
    pair.run(0.2, JointCommand(DriveGoal.POSITION, 0.5, position_rad=0.4))
    pair.run(1.0, JointCommand(DriveGoal.POSITION, 0.5, position_rad=-0.2))
    assert pair.drive.joint.position_rad == pytest.approx(-0.2, abs=0.003)


@pytest.mark.parametrize("follows", [Follows.VELOCITY, Follows.POSITION])
def test_a_blocked_joint_presses_with_its_limit_and_no_more(table_4, follows):
    """The torque limit of hand.toml is in the drive's own 6072h."""
    stop = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.5, max_rad=0.01)
    pair = Pair(table_4[0], follows, parameters=stop)
    limit_Nm = table_4[0].joints[0].torque_limit_Nm
    goal = DriveGoal.VELOCITY if follows is Follows.VELOCITY else DriveGoal.POSITION
    pair.run(1.0, JointCommand(goal, 1.9, velocity_rad_s=0.5, position_rad=0.4))
    assert pair.drive.torque_Nm == pytest.approx(limit_Nm, rel=0.01)
    assert pair.drive.torque_Nm <= limit_Nm


@pytest.mark.parametrize("follows", list(Follows))
@pytest.mark.parametrize("direction", [1, -1])
def test_homing_finds_the_lower_switch_and_makes_it_the_home_position(table_4, follows, direction):
    """Method 17: 6064h is the home offset at the switch, wherever the drive began to count."""
    homing = HomingConfig(method=17, search_rad_s=0.5)
    shifted = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.3, max_rad=0.7)
    pair = Pair(table_4[0], follows, homing, parameters=shifted, direction=direction)
    home = JointCommand(DriveGoal.HOME)
    pair.run(0.2, home)
    assert pair.drive.homing is HomingState.MISSING
    pair.run(1.0, home)
    assert pair.drive.homing is HomingState.ATTAINED
    assert pair.plant.position_rad == pytest.approx(-0.3, abs=0.003)
    assert pair.drive.joint.position_rad == pytest.approx(-0.5 * direction, abs=0.003)
    pair.run(0.5, home)  # homed: nothing moves again
    assert pair.plant.position_rad == pytest.approx(-0.3, abs=0.003)


@pytest.mark.parametrize("direction", [1, -1])
def test_homing_by_method_18_seeks_the_upper_switch(table_4, direction):
    homing = HomingConfig(method=18, search_rad_s=0.5)
    shifted = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=-0.7, max_rad=0.3)
    pair = Pair(table_4[0], Follows.TORQUE, homing, parameters=shifted, direction=direction)
    pair.run(1.5, JointCommand(DriveGoal.HOME))
    assert pair.drive.homing is HomingState.ATTAINED
    assert pair.plant.position_rad == pytest.approx(0.3, abs=0.003)
    assert pair.drive.joint.position_rad == pytest.approx(-0.5 * direction, abs=0.003)


@pytest.mark.parametrize("method", [35, 37])
@pytest.mark.parametrize("direction", [1, -1])
def test_homing_where_the_joint_is_moves_nothing(table_4, method, direction):
    pair = Pair(table_4[0], Follows.TORQUE, HomingConfig(method=method), direction=direction)
    pair.plant.position_rad = 0.2
    pair.run(0.3, JointCommand(DriveGoal.HOME))
    assert pair.drive.homing is HomingState.ATTAINED
    assert pair.plant.position_rad == pytest.approx(0.2, abs=0.003)
    assert pair.drive.joint.position_rad == pytest.approx(-0.5 * direction, abs=0.003)


@pytest.mark.parametrize(("method", "reach_rad"), [(17, (-0.3, 0.0)), (18, (0.0, 0.3))])
def test_the_wrong_switch_is_a_homing_error(table_4, method, reach_rad):
    at_other_end = JointParameters(load_stiffness_Nm_rad=0.0, min_rad=reach_rad[0], max_rad=reach_rad[1])
    pair = Pair(table_4[0], Follows.TORQUE, HomingConfig(method=method), parameters=at_other_end)
    pair.run(0.3, JointCommand(DriveGoal.HOME))
    assert pair.drive.homing is HomingState.ERROR


def orders(table_4, follows, **control):
    config = changed(table_4[0], "control", drives_follow=follows, **control)
    return JointOrders(config.joints, config.control), config


def test_orders_keep_their_rates_and_ranges(table_4):
    rest = np.array([0.5 * (joint.min_rad + joint.max_rad) for joint in table_4[0].joints])
    some = np.full(9, 0.4)
    torque, _ = orders(table_4, Follows.TORQUE, torque_rate_Nm_s=10.0)
    assert [torque.moving(some, rest)[0].torque_Nm for _ in range(5)] == pytest.approx(
        [0.1, 0.2, 0.3, 0.4, 0.4]
    )
    velocity, _ = orders(table_4, Follows.VELOCITY, B_d_Nms_rad=0.5, acceleration_limit_rad_s2=20.0)
    speeds = [velocity.moving(some, rest)[0].velocity_rad_s for _ in range(5)]
    assert speeds == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.8])
    assert velocity.moving(100 * some, rest)[0].velocity_rad_s <= 2.0
    position, config = orders(table_4, Follows.POSITION, B_d_Nms_rad=0.5)
    blocked = [position.moving(some, rest)[0].position_rad for _ in range(100)]
    assert blocked[0] == pytest.approx(rest[0] + 0.005) and blocked[-1] == pytest.approx(rest[0] + LEAD_RAD)
    upper = np.array([joint.max_rad for joint in config.joints])
    assert position.moving(some, upper)[0].position_rad <= upper[0]
    assert velocity.moving(some, upper)[0].velocity_rad_s <= 0.0
    assert velocity.moving(some, upper + 0.01)[0].velocity_rad_s < 0.0


@pytest.mark.parametrize(
    "follows", [pytest.param(Follows.VELOCITY, marks=pytest.mark.slow), Follows.POSITION]
)
def test_the_hand_grasps_and_turns_with_drives_that_follow(bench, table_4, follows):
    config, hand = table_4
    config = msgspec.structs.replace(config, run=RunConfig(start=StartMode.COMMAND))
    config = changed(config, "control", drives_follow=follows, force_law=ForceLaw.ADMITTANCE, B_d_Nms_rad=0.3)
    rig = load("closed_loop").make_closed_loop(bench, config, hand)
    rig.run(1.0)
    assert rig.statuses[-1].mode is Mode.READY
    rig.largest_force_N = 0.0  # the start pose presses the domes into the object
    rig.core.command(Grasp())
    rig.run(1.0)
    before = rig.engine.object_rotation.copy()
    rig.core.command(Rotate((0.0, 0.0, 10.0), ramp_s=1.0))
    rig.run(2.0)
    status = rig.statuses[-1]
    assert status.mode is Mode.MANIPULATE, status.reason
    turned = rig.engine.object_rotation @ before.T
    yaw_deg = math.degrees(math.atan2(turned[1, 0], turned[0, 0]))
    print(
        f"{follows.value}: yaw {yaw_deg:.2f} of 10 deg, error {status.orientation_error_deg:.2f} deg,"
        f" force at most {rig.largest_force_N:.1f} N"
    )
    assert yaw_deg > 5.0
    assert rig.largest_force_N < config.limits.contact_force_N


def homing_bench(bench, table_4, **homing):
    config, hand = table_4
    config = homing_config(config, **homing)
    rig = bench.VirtualBench(config, hand)
    rig.drives = [SimulatedDrive(joint.drive_node, shifted(joint)) for joint in config.joints]
    return config, rig


def test_the_host_homes_every_drive_before_it_is_ready_and_not_again_after_recover(bench, table_4):
    config, rig = homing_bench(bench, table_4)
    rig.run(5.0)
    check_homed(config, rig)
    rig.core.command(Stop())
    rig.run(1.0)
    rig.drives[0].plant.position_rad += 0.1
    rig.core.command(Recover())
    before = len(rig.statuses)
    rig.run(1.0)
    assert rig.statuses[-1].mode is Mode.READY
    assert rig.statuses[-1].joints[0].position_rad > config.joints[0].min_rad + 0.05
    assert Mode.INIT in {status.mode for status in rig.statuses[before:]}


def test_a_drive_that_does_not_come_home_in_time_is_a_fault(bench, table_4):
    _, rig = homing_bench(bench, table_4, search_rad_s=0.05, timeout_s=0.5)
    rig.run(2.0)
    status = rig.statuses[-1]
    assert status.mode is Mode.FAULT
    assert "not homed within homing.timeout_s = 0.5 s" in status.reason and "abduction_1" in status.reason


def test_hand_toml_is_refused_without_the_sensors_force_or_a_home(tmp_path, bench):
    text = bench.TABLE_4.read_text()
    path = tmp_path / "hand.toml"
    path.write_text(text.replace("[control]", '[control]\ndrives_follow = "velocity"'))
    with pytest.raises(ConfigError, match=r"drives_follow = 'velocity' needs control\.force_law"):
        hand_reader.load(path)
    path.write_text(text + "\n[homing]\nmethod = 17\n")
    with pytest.raises(ConfigError, match="home_rad of abduction_1"):
        hand_reader.load(path)
