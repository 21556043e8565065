"""Simulated hand with a CiA 402 drive on each joint: the link between bus and physics engine.

A joint without power stays where it is: gear and detent torque of Table 4's motor (20:1) carry the finger's
weight. This is modelled as a brake that is released while the drive is enabled.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.config.hand_config import HandConfig, JointConfig
from palpate_host.drives.cia402_device import Cia402AxesDevice, Cia402Device, DriveNode
from palpate_host.drives.cia402_motion import MotorState
from palpate_host.drives.drive_axis import Motor
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.joint_servo import JointServo
from palpate_twin.hand.engine import Engine


class HandMotor:
    """Table 4's motor on a joint of the engine; its angles have the drive's zero and direction."""

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
        """True if the torque depends on the joint's current position or velocity."""
        return self._command.goal in (DriveGoal.VELOCITY, DriveGoal.POSITION, DriveGoal.HOME)

    def joint_torque_Nm(self, step_s: float) -> float:
        """Return the torque on the joint over the next step, positive in the direction of q."""
        state = self._state
        self._torque_Nm = self._servo.torque_Nm(
            self._command, state.position_rad, state.velocity_rad_s, step_s
        )
        return self._joint.direction * self._torque_Nm

    def set_joint_state(self, q_rad: float, qdot_rad_s: float) -> None:
        """Update position and velocity from the engine."""
        joint, direction = self._joint, self._joint.direction
        at_limit = direction * (int(q_rad >= joint.max_rad) - int(q_rad <= joint.min_rad))
        self._state = MotorState(
            position_rad=direction * (q_rad - joint.zero_offset_rad),
            velocity_rad_s=direction * qdot_rad_s,
            torque_Nm=self._torque_Nm,
            at_limit=at_limit,
        )

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - updated by set_joint_state
        return self._state

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - no delay
        self.is_powered = command.goal not in (DriveGoal.OFF, DriveGoal.QUICK_STOP)
        self._command = command

    def reset_fault(self) -> None:
        """Do nothing: the simulated motor has no faults."""


def devices_of(joints: Sequence[JointConfig], motors: Sequence[Motor]) -> list[DriveNode]:
    """Return the drive nodes of these joints, each with the motors of its joints."""
    nodes: dict[int, DriveNode] = {}
    axes: dict[int, dict[int, Motor]] = {}
    for joint, motor in zip(joints, motors, strict=True):
        if joint.axis is None:
            nodes[joint.drive_node] = Cia402Device(joint.drive_node, motor)
        else:
            axes.setdefault(joint.drive_node, {})[joint.axis] = motor
    nodes |= {node_id: Cia402AxesDevice(node_id, of_node) for node_id, of_node in axes.items()}
    return [nodes[node_id] for node_id in dict.fromkeys(joint.drive_node for joint in joints)]


class DrivenHand:
    """The engine with its drives; `step` advances both by the engine's step."""

    def __init__(self, config: HandConfig, engine: Engine) -> None:
        self.engine = engine
        self._motors = [HandMotor(joint) for joint in config.joints]
        self.devices = devices_of(config.joints, self._motors)
        self._powered = [False] * len(self._motors)
        self.read_joints()
        engine.brake(np.ones(len(self._motors), dtype=bool))

    @property
    def is_powered(self) -> bool:
        """True if a drive is enabled, so that commands hold a joint and not its brake."""
        return any(motor.is_powered for motor in self._motors)

    def step(self) -> None:
        powered = [motor.is_powered for motor in self._motors]
        if powered != self._powered:
            self._powered = powered
            self.engine.brake(np.logical_not(powered))
        if any(motor.is_servoing for motor in self._motors):
            self.read_joints()
        self.engine.step(np.array([motor.joint_torque_Nm(self.engine.step_s) for motor in self._motors]))

    def read_joints(self) -> None:
        """Update the drives' joint positions; has to be called before the drives are served."""
        for motor, q_rad, qdot_rad_s in zip(
            self._motors, self.engine.q_rad.tolist(), self.engine.qdot_rad_s.tolist(), strict=True
        ):
            motor.set_joint_state(q_rad, qdot_rad_s)
