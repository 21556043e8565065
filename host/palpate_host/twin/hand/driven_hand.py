"""A hand with a CiA 402 drive on each joint: what stands between the bus and the physics.

A joint without power stands: gear and detent torque of Table 4's motor (20:1) hold the finger's weight. Here
that is a brake, which the drive lets go while it commands torque.
"""

from __future__ import annotations

import numpy as np

from palpate_host.drives.cia402_device import Cia402Device, MotorState
from palpate_host.drives.joint_command import DriveGoal, JointCommand
from palpate_host.hand_config import HandConfig, JointConfig
from palpate_host.twin.drive_plant import JointParameters
from palpate_host.twin.hand.engine import Engine


class HandMotor:
    """Table 4's motor on a joint that the engine moves; the angles are the drive's own."""

    def __init__(self, joint: JointConfig) -> None:
        self._joint = joint
        self.rated_torque_mNm = round(JointParameters().rated_torque_Nm * 1000)
        self.is_powered = False
        self._torque_Nm = 0.0
        self._state = MotorState(0.0, 0.0)

    @property
    def joint_torque_Nm(self) -> float:
        """On the joint, in the direction of q."""
        return self._joint.direction * self._torque_Nm

    def moved(self, q_rad: float, qdot_rad_s: float) -> None:
        """Where the engine brought the joint."""
        direction = self._joint.direction
        self._state = MotorState(direction * (q_rad - self._joint.zero_offset_rad), direction * qdot_rad_s)

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - the hand keeps it up to date
        return self._state

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - no delay
        self.is_powered = command.goal is DriveGoal.TORQUE
        self._torque_Nm = command.torque_Nm if self.is_powered else 0.0

    def reset_fault(self) -> None:
        """Has none."""


class DrivenHand:
    """The engine under its drives; `step` moves it on by the engine's step."""

    def __init__(self, config: HandConfig, engine: Engine) -> None:
        self.engine = engine
        self._motors = [HandMotor(joint) for joint in config.joints]
        self.devices = [
            Cia402Device(joint.drive_node, motor)
            for joint, motor in zip(config.joints, self._motors, strict=True)
        ]
        self._powered = [False] * len(self._motors)
        self.look()
        engine.brake(np.ones(len(self._motors), dtype=bool))

    @property
    def is_powered(self) -> bool:
        """Whether any joint is held by commands, not by its brake."""
        return any(motor.is_powered for motor in self._motors)

    def step(self) -> None:
        powered = [motor.is_powered for motor in self._motors]
        if powered != self._powered:
            self._powered = powered
            self.engine.brake(np.logical_not(powered))
        self.engine.step(np.array([motor.joint_torque_Nm for motor in self._motors]))

    def look(self) -> None:
        """The drives see where their joints are: to be called before they are served."""
        for motor, q_rad, qdot_rad_s in zip(
            self._motors, self.engine.q_rad.tolist(), self.engine.qdot_rad_s.tolist(), strict=True
        ):
            motor.moved(q_rad, qdot_rad_s)
