"""The whole hand with an object in virtual time, and what can break in it: physics, drives, fingertips, host.

A `VirtualBench` whose joints are moved by MuJoCo with friction, whose fingertips feel that object, and whose
nodes, host and contacts can be broken and mended while it runs.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np

from palpate_edge.common.contact import Contact
from palpate_host.common.joint_command import DriveGoal, JointCommand
from palpate_host.config.hand_config import HandConfig, JointConfig
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.cia402_motion import MotorState
from palpate_host.service.host_core import HostCore
from palpate_twin.drives.drive_plant import JointParameters
from palpate_twin.drives.joint_servo import JointServo
from palpate_twin.paper.trial import make_engine

STANDING = (DriveGoal.OFF, DriveGoal.QUICK_STOP)


class EngineMotor:
    """Table 4's motor on a joint of the engine; it follows torque, velocity and position."""

    damper_Nms_rad = 0.0
    step_s = 0.0005

    def __init__(self, joint: JointConfig) -> None:
        assert joint.direction == 1 and joint.zero_offset_rad == 0.0
        self.rated_torque_mNm = round(JointParameters().rated_torque_Nm * 1000)
        self.q_rad = self.qdot_rad_s = 0.0  # the loop keeps them up to date
        self.error_code = 0
        self.ordered_Nm = 0.0  # the torque, or the most torque, that the drive may give
        self.command = JointCommand(DriveGoal.OFF)
        self.servo = JointServo()

    @property
    def joint_torque_Nm(self) -> float:
        return self.servo.torque_Nm(self.command, self.q_rad, self.qdot_rad_s, self.step_s)

    def state(self, now_us: int) -> MotorState:  # noqa: ARG002 - the loop keeps it up to date
        return MotorState(self.q_rad, self.qdot_rad_s, self.error_code)

    def order(self, now_us: int, command: JointCommand) -> None:  # noqa: ARG002 - no delay
        self.command = command
        self.ordered_Nm = command.torque_Nm if command.goal not in STANDING else 0.0

    def reset_fault(self) -> None:
        self.error_code = 0


class AdmittanceMotor(EngineMotor):
    """A geared stepper under velocity command, qdot = torque / B_d: stiff against everything else.

    Its damper belongs to the engine's joint, which takes it implicitly; a sampled one would ring.
    """

    B_d_Nms_rad = 0.3
    damper_Nms_rad = 30.0

    @property
    def joint_torque_Nm(self) -> float:
        return self.damper_Nms_rad * self.ordered_Nm / self.B_d_Nms_rad


@dataclass(slots=True)
class Doubt:
    """What is wrong with one fingertip's contacts. late_us: it publishes old frames."""

    kind: str = ""
    late_us: int = 0


def make_closed_loop(
    bench, config: HandConfig, hand: HandKinematics, motor: type[EngineMotor] = EngineMotor, seed=0
):
    """A rig of `bench` (the module virtual_bench.py) around a fresh engine."""

    class ClosedLoop(bench.VirtualBench):
        def __init__(self) -> None:
            super().__init__(config, hand)
            self.config = config
            self.engine = make_engine(config, "mujoco", has_B=False)
            twin = self.engine.twin
            twin.model.dof_damping[twin.v_address] += motor.damper_Nms_rad
            self.motors = [motor(joint) for joint in config.joints]
            pairs = zip(config.joints, self.motors, strict=True)
            self.drives = [Cia402Device(joint.drive_node, one) for joint, one in pairs]
            self.doubts: list[list[Doubt]] = [[] for _ in config.fingers]
            self.faults: Counter[tuple[int, int]] = Counter()
            self.rng = np.random.default_rng(seed)
            self._last: list[Contact | None] = [None] * len(config.fingers)
            self._pending: list[tuple[int, int, Contact]] = []
            self.largest_force_N = 0.0
            self.joint_reach_rad = np.array([[np.inf] * len(config.joints), [-np.inf] * len(config.joints)])
            self.largest_order_ratio = 0.0
            self._torque_limit_Nm = np.array([joint.torque_limit_Nm for joint in config.joints])
            self.torque_trace: list[tuple[int, np.ndarray]] = []
            self._is_braked = True  # gear and detent torque hold the start pose, as in DrivenHand
            self.engine.brake(np.ones(len(self.motors), dtype=bool))

        def pose(self) -> HandPose:
            return self.hand.pose(self.engine.q_rad)

        def _advance_joints(self) -> None:
            """The engine moves them."""

        def power_up(self, node_id: int) -> None:
            """The node begins anew, as a process or a drive does that had no power."""
            self.silent.discard(node_id)
            self.drives = [
                Cia402Device(node_id, one) if drive.slave.node_id == node_id else drive
                for drive, one in zip(self.drives, self.motors, strict=True)
            ]
            self.tips = [
                bench.make_tip(node_id) if tip.slave.node_id == node_id else tip for tip in self.tips
            ]
            self.wake(node_id)

        def start_host(self) -> None:
            """A new process: nothing of the old one is known."""
            self.silent.discard(self.host_id)
            self.core, self.host_queue = HostCore(self.config, self.hand), []

        def _step(self) -> None:
            engine = self.engine
            joints = zip(self.motors, engine.q_rad.tolist(), engine.qdot_rad_s.tolist(), strict=True)
            for one, q_rad, qdot_rad_s in joints:
                one.q_rad, one.qdot_rad_s = q_rad, qdot_rad_s
            super()._step()
            for one, drive in zip(self.motors, self.drives, strict=True) if self.silent else ():
                if drive.slave.node_id in self.silent:
                    one.order(self.now_us, JointCommand(DriveGoal.OFF))  # a drive without power
            if self._is_braked and all(one.command.goal not in STANDING for one in self.motors):
                self._is_braked = False
                engine.brake(np.zeros(len(self.motors), dtype=bool))
            engine.step(np.array([one.joint_torque_Nm for one in self.motors]))
            self._watch()

        def _watch(self) -> None:
            q_rad = self.engine.q_rad
            np.minimum(self.joint_reach_rad[0], q_rad, out=self.joint_reach_rad[0])
            np.maximum(self.joint_reach_rad[1], q_rad, out=self.joint_reach_rad[1])
            ratio = np.abs([one.ordered_Nm for one in self.motors]) / self._torque_limit_Nm
            self.largest_order_ratio = max(self.largest_order_ratio, float(ratio.max()))
            self.torque_trace.append((self.now_us, ratio))
            for touch in self.engine.tip_contacts():
                if touch is not None:
                    self.largest_force_N = max(self.largest_force_N, touch.normal_force_N)

        def _feel_and_publish(self, now_us: int) -> None:
            due = [f for f in range(len(self.tips)) if now_us >= self._next_exposure_us[f]]
            if due:
                pose, touches = self.pose(), self.engine.tip_contacts()
            for finger in due:
                self._next_exposure_us[finger] += bench.FRAME_PERIOD_US
                self._sequence[finger] += 1
                contact = self._felt(finger, touches[finger], pose, now_us)
                if contact is not None:
                    late_us = max((doubt.late_us for doubt in self.doubts[finger]), default=0)
                    self._pending.append((now_us + bench.DELAY_US + late_us, finger, contact))
            ready = [item for item in self._pending if now_us >= item[0]]
            self._pending = [item for item in self._pending if now_us < item[0]]
            for _, finger, contact in ready:
                self.wake(self.tips[finger].slave.node_id)
                self.tips[finger].publish(contact, min(now_us - contact.exposed_at_us, 65_000))

        def _felt(self, finger: int, touch, pose: HandPose, now_us: int) -> Contact | None:
            point = None
            if touch is not None:
                arm = pose.tip_rotation[finger].T @ (touch.point_m - pose.tip_centre_m[finger])
                point = tuple(1e3 * self.config.control.tip_radius_m * arm / np.linalg.norm(arm))
            made = bench.contact_at(point, self._sequence[finger], now_us)
            made = replace(made, normal_force_N=0.0 if touch is None else min(touch.normal_force_N, 32.0))
            kinds = {doubt.kind for doubt in self.doubts[finger]}
            last = self._last[finger]
            if "camera stalled" in kinds:
                return None
            if "camera gone" in kinds:
                return replace(made, valid=False, in_contact=False, position_mm=None, normal_force_N=0.0)
            if "frozen" in kinds and last is not None:
                return replace(last, sequence=made.sequence, exposed_at_us=now_us)
            if "wild" in kinds:
                direction = self.rng.normal(size=3)
                point = tuple(30.0 * np.abs(direction) / np.linalg.norm(direction))
                force_N = float(self.rng.uniform(0.0, 30.0))
                return replace(made, in_contact=True, position_mm=point, normal_force_N=force_N)
            self._last[finger] = made
            return made

    return ClosedLoop()
