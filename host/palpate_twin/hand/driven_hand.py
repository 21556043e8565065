"""A hand with a CiA 402 drive on each joint: what stands between the bus and the physics.

A joint without power stands: gear and detent torque of Table 4's motor (20:1) hold the finger's weight. Here
that is a brake, which the drive lets go while it moves the joint.
"""

from __future__ import annotations

import numpy as np

from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.config.hand_config import HandConfig, JointConfig
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.cia402_motion import MotorState
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.joint_servo import JointServo
from palpate_twin.hand.engine import Engine


class HandMotor:
    """Table 4's motor on a joint that the engine moves; the angles are the drive's own."""

    def __init__(self, joint: JointConfig) -> None:
        self._joint = joint
        self.rated_torque_mNm = round(JointParameters().rated_torque_Nm * 1000)
        self.is_powered = False
        self._servo = JointServo()
        self._command = JointCommand(DriveGoal.OFF)
        self._torque_Nm = 0.0
        self._state = MotorState(0.0, 0.0)

    @property
    def is_servoing(self) -> bool:
        """Its torque depends on where the joint is now."""
        return self._command.goal in (DriveGoal.VELOCITY, DriveGoal.POSITION, DriveGoal.HOME)

    def joint_torque_Nm(self, step_s: float) -> float:
        """On the joint over the next step, in the direction of q."""
        state = self._state
        self._torque_Nm = self._servo.torque_Nm(
            self._command, state.position_rad, state.velocity_rad_s, step_s
        )
        return self._joint.direction * self._torque_Nm

    def moved(self, q_rad: float, qdot_rad_s: float) -> None:
        """Where the engine brought the joint."""
        joint, direction = self._joint, self._joint.direction
        at_limit = direction * (int(q_rad >= joint.max_rad) - int(q_rad <= joint.min_rad))
        self._state = MotorState(
            position_rad=direction * (q_rad - joint.zero_offset_rad),
            velocity_rad_s=direction * qdot_rad_s,
            torque_Nm=self._torque_Nm,
            at_limit=at_limit,
        )

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - the hand keeps it up to date
        return self._state

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - no delay
        self.is_powered = command.goal not in (DriveGoal.OFF, DriveGoal.QUICK_STOP)
        self._command = command

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
        if any(motor.is_servoing for motor in self._motors):
            self.look()
        self.engine.step(np.array([motor.joint_torque_Nm(self.engine.step_s) for motor in self._motors]))

    def look(self) -> None:
        """The drives see where their joints are: to be called before they are served."""
        for motor, q_rad, qdot_rad_s in zip(
            self._motors, self.engine.q_rad.tolist(), self.engine.qdot_rad_s.tolist(), strict=True
        ):
            motor.moved(q_rad, qdot_rad_s)
