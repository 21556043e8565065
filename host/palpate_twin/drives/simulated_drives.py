"""Simulated CiA 402 joint drives: the software of a real device with a simulated motor and joint."""

from __future__ import annotations

from collections.abc import Mapping

from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.drives.cia402_device import Cia402AxesDevice, Cia402Device
from palpate_host.drives.cia402_motion import MotorState
from palpate_twin.drives.drive_plant import LONGEST_ADVANCE_US, LONGEST_STEP_US, JointParameters, JointPlant
from palpate_twin.drives.joint_servo import JointServo


class PlantMotor:
    """Motor of a simulated joint, which follows the last command, with limit switches at the joint limits."""

    def __init__(self, plant: JointPlant) -> None:
        self.plant = plant
        self.rated_torque_mNm = round(plant.parameters.rated_torque_Nm * 1000)
        self._servo = JointServo()
        self._command = JointCommand(DriveGoal.OFF)
        self._torque_Nm = 0.0
        self._now_us: int | None = None

    def state(self, now_us: int) -> MotorState:
        remaining_us = 0 if self._now_us is None else min(now_us - self._now_us, LONGEST_ADVANCE_US)
        self._now_us = now_us
        plant, parameters = self.plant, self.plant.parameters
        if self._command.goal not in (DriveGoal.VELOCITY, DriveGoal.POSITION):
            self._torque_Nm = self._servo.torque_Nm(self._command, 0.0, 0.0, 0.0)
            plant.advance(remaining_us, self._torque_Nm)
            remaining_us = 0
        while remaining_us > 0:
            step_us = min(LONGEST_STEP_US, remaining_us)
            remaining_us -= step_us
            self._torque_Nm = self._servo.torque_Nm(
                self._command, plant.position_rad, plant.velocity_rad_s, step_us * 1e-6
            )
            plant.advance(step_us, self._torque_Nm)
        q_rad = plant.position_rad
        at_limit = int(q_rad >= parameters.max_rad) - int(q_rad <= parameters.min_rad)
        return MotorState(q_rad, plant.velocity_rad_s, torque_Nm=self._torque_Nm, at_limit=at_limit)

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - the plant has no delay
        self._command = command

    def reset_fault(self) -> None:
        """Do nothing: the simulated motor has no faults."""


class SimulatedDrive(Cia402Device):
    """A simulated drive with its joint."""

    def __init__(self, node_id: int, joint: JointParameters | None = None) -> None:
        """Create the drive. joint: None for Table 4's motor with a load about 0 rad."""
        self.plant = JointPlant(joint or JointParameters())
        self.motor = PlantMotor(self.plant)
        self.motors = (self.motor,)
        super().__init__(node_id, self.motor)


class SimulatedAxes(Cia402AxesDevice):
    """A simulated node with several axes and their joints. motors: in the order of the axes' numbers."""

    def __init__(self, node_id: int, joints: Mapping[int, JointParameters]) -> None:
        """Create the node. joints: by axis."""
        motors = {axis: PlantMotor(JointPlant(joint)) for axis, joint in sorted(joints.items())}
        self.motors = tuple(motors.values())
        super().__init__(node_id, motors)
