"""A simulated CiA 402 joint drive: a real device's software with a simulated joint.

It differs from a real drive in its motor alone, so that hardware takes its place by a change of the bus.
"""

from __future__ import annotations

from palpate_host.drives.cia402_device import Cia402Device, MotorState
from palpate_host.drives.joint_command import DriveGoal, JointCommand
from palpate_host.twin.drive_plant import JointParameters, JointPlant


class PlantMotor:
    """A simulated joint under the torque that it was asked for last."""

    def __init__(self, plant: JointPlant) -> None:
        self.plant = plant
        self.rated_torque_mNm = round(plant.parameters.rated_torque_Nm * 1000)
        self._torque_Nm = 0.0
        self._now_us: int | None = None

    def state(self, now_us: int) -> MotorState:
        if self._now_us is not None:
            self.plant.advance(now_us - self._now_us, self._torque_Nm)
        self._now_us = now_us
        return MotorState(self.plant.position_rad, self.plant.velocity_rad_s)

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - the plant has no delay
        self._torque_Nm = command.torque_Nm if command.goal is DriveGoal.TORQUE else 0.0

    def reset_fault(self) -> None:
        """A simulated joint has no fault of its own."""


class SimulatedDrive(Cia402Device):
    """One drive and its joint."""

    def __init__(self, node_id: int, joint: JointParameters | None = None) -> None:
        """`joint`: Table 4's motor with a load about 0 rad when None."""
        self.plant = JointPlant(joint or JointParameters())
        super().__init__(node_id, PlantMotor(self.plant))
