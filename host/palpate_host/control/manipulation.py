"""The manipulation of the object: contacts and target in, desired virtual frame and joint torques out.

Keeps the state of Eqs. (9)-(16) from tick to tick, and nothing of the bus: the estimate M, the object's
orientation when turning began, the progress of the ramp, and an integral that the paper does not have. The
paper's proportional law leaves an error; the integral moves the target until the error is gone. It starts at
the end of the ramp: the last degrees need the most friction, and the slower they are turned the less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.gait_plan import GaitPlan
from palpate_host.common.joint_command import Follows
from palpate_host.common.mode import MOVING, Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.contact_force import ContactForce
from palpate_host.control.control_law import (
    Gains,
    force_torque_Nm,
    grasp_force_N,
    joint_torque_Nm,
    limit_torque_Nm,
    target_step,
)
from palpate_host.control.gait.gait import Gait
from palpate_host.control.gait.reorientation import Reorientation
from palpate_host.control.joint_hold import JointHold, joint_hold
from palpate_host.control.kinematics import HandPose
from palpate_host.control.object_orientation import ObjectOrientation, contact_normal
from palpate_host.control.pose_law import PoseLaw
from palpate_host.control.tip_friction import ANSWER_US, TipFriction, friction_ratio
from palpate_host.control.virtual_frame import desired_virtual_frame, virtual_frame

TRIM_LIMIT_RAD = math.radians(15.0)
"""Limit of the integral: Eq. (14) leaves an error of a few degrees, a larger one is a jammed object."""
HELD = (Mode.GRASP, Mode.MANIPULATE, Mode.BLIND)
"""Modes in which the pose law may hold an object."""
HELD_STILL = "a contact is too old"
"""Why a turn by finger gaiting stops in HOLD."""
NOT_HELD = "the turn by finger gaiting ended: the object is held no more"
RELEASE_RATIO = 0.25
"""Opening force over grasp force."""


class Manipulation:
    """The controller with its state; call `torque_Nm` once a tick."""

    def __init__(self, config: HandConfig) -> None:
        self.gains = gains_of(config)
        self._control = control = config.control
        self.orientation = ObjectOrientation(
            len(config.fingers), control.reference_frames, control.contact_filter_s
        )
        self.R_d: Array | None = None
        self.R_d_vir: Array | None = None
        self._force = ContactForce(len(config.fingers), control, config.staleness.freeze_ms * 1e-3)
        self._blind_by_choice = control.mode is ControlMode.BLIND
        self._turn_rad = rotation.log(rotation.from_rpy_deg(*config.target.rpy_deg))
        self._ramp_s = config.target.ramp_s
        self._turned_s = 0.0
        self._start: Array | None = None
        self._is_led = False
        self._carries = control.object_weight_N > 0.0 or control.position_stiffness_N_m > 0.0
        self._hold_at_m: Array | None = None
        self._integral_per_s = 0.0 if self._blind_by_choice else control.integral_per_s
        self._trim_rad = np.zeros(3)
        self.pose_law: PoseLaw | None = None
        if control.law is ControlLaw.POSE:
            self.pose_law = PoseLaw(control, config.pose_law, self.gains, len(config.fingers))
            self._integral_per_s = 0.0  # the law has its own
        self._pose_config = config.pose_law
        self.friction = [TipFriction(config.pose_law.friction)] * len(config.fingers)
        self._squeezed_until_us = 0
        self._settle_s, self._grasped_s = control.settle_ms * 1e-3, 0.0
        self._law_M: Array | None = None
        self._still: JointHold | None = None
        self._pose: HandPose | None = None
        self.reorientation = Reorientation()

    def turn(self, rpy_deg: tuple[float, float, float], ramp_s: float) -> None:
        """Start a turn from the last desired orientation, or from the measured one when there is none.

        Raises CommandError, and changes nothing, while a turn by finger gaiting is planned or under way, and
        while a finger is lifted after one was stopped.
        """
        self.reorientation.check_free("the turn")
        self._end_gait()
        self._turn_rad = rotation.log(rotation.from_rpy_deg(*rpy_deg))
        self._ramp_s, self._turned_s = ramp_s, 0.0
        self._start = self.R_d
        if self.pose_law is not None and self.pose_law.target is not None:
            self.pose_law.target.shift(np.zeros(3))

    def move(
        self, xyz_mm: tuple[float, float, float], rpy_deg: tuple[float, float, float], ramp_s: float
    ) -> None:
        """Start a move and a turn from the last desired pose.

        Raises CommandError, and changes nothing, under another law, while no object is held, or when the
        target is beyond the workspace.
        """
        if self.pose_law is None:
            raise CommandError("move is refused: it needs control.law = 'pose' in hand.toml")
        self._check_moving("move")
        shift_m = 1e-3 * np.array(xyz_mm)
        target = self.pose_law.reachable_target(shift_m, rotation.from_rpy_deg(*rpy_deg))
        self.turn(rpy_deg, ramp_s)
        target.shift(shift_m)

    def _check_moving(self, what: str) -> None:
        """Raise CommandError, naming the refused command, while the hand holds still in HOLD."""
        if self._still is not None:
            raise CommandError(f"{what} is refused: contacts are too old; wait until the hand leaves HOLD")

    def request_turn(
        self, rpy_deg: tuple[float, float, float], corners_mm: Sequence[tuple[float, float, float]]
    ) -> None:
        """Request the plan of a turn by finger gaiting; the object is held meanwhile.

        corners_mm: of the convex object in the hand's frame. Raises CommandError, and changes nothing, where
        the hand cannot turn an object so, or not now.
        """
        law, pose = self.pose_law, self._pose
        if law is None or law.object is None or pose is None:
            raise CommandError("reorient is refused: it needs control.law = 'pose' and a held object")
        self._check_moving("reorient")
        if self.R_d is not None and self.turned < 1.0:
            raise CommandError("reorient is refused: the object is being turned; wait until it is there")
        was_gaiting = self.gait is not None
        self.reorientation.ask(law, pose, self.gains, rpy_deg, corners_mm)
        if was_gaiting:
            self._forget_normals()
        self._turn_rad, self._ramp_s, self._turned_s = np.zeros(3), 0.0, 0.0
        self._start, self._is_led = self.R_d, False

    def take_plan(self, plan: GaitPlan | None, problem: str) -> None:
        """Take the answer to `request_turn`: start the turn, or note why not."""
        if self.pose_law is not None:
            self.reorientation.take_plan(self.pose_law, self.gains, plan, problem)

    @property
    def gait(self) -> Gait | None:
        """The turn by finger gaiting that is under way, or was the last one; None before and after it."""
        return self.reorientation.gait

    def start_gait(self, plan: GaitPlan) -> None:
        """Start a planned turn of the held object by finger gaiting, from the last desired orientation.

        Raises CommandError while the pose law holds no object, and while another such turn is under way.
        """
        if self.pose_law is None or self.pose_law.object is None:
            raise CommandError("gait is refused: it needs control.law = 'pose' and a held object")
        if self.reorientation.is_under_way:
            raise CommandError("gait is refused: another one is under way; wait until it is over")
        self.reorientation.gait = Gait(plan, self.pose_law, self.gains)

    def _end_gait(self, problem: str = "") -> None:
        """End a turn by finger gaiting, done or not; problem: why, if it is not."""
        was_gaiting, self._is_led = self.gait is not None, False
        self.reorientation.end(problem)
        if was_gaiting:
            self._forget_normals()

    def _forget_normals(self) -> None:
        """Collect the contacts' references again: fingers have taken hold of other faces."""
        control = self._control
        fingers = len(self.friction)
        self.orientation = ObjectOrientation(fingers, control.reference_frames, control.contact_filter_s)

    def stop_turning(self) -> None:
        """Forget the desired orientation: the next turn starts from the measured one.

        A turn by finger gaiting ends here; a lifted finger takes hold first.
        """
        if self.pose_law is not None and self.gait is not None:
            if self.reorientation.lifted is not None:
                self.gait.close(self.pose_law)
                return
            self.pose_law.end_gait()
        self._end_gait()
        self.R_d = self.R_d_vir = self._start = None
        self._trim_rad = np.zeros(3)
        if self.pose_law is not None:
            self.pose_law.hold_here()

    @property
    def M(self) -> Array | None:
        """R_vir^T R_c; the identity in Tahara's blind law, which takes the virtual frame for the object's.

        While the pose law holds an object, R_c is its estimate.
        """
        if self._law_M is not None:
            return self._law_M
        return np.eye(3) if self._blind_by_choice else self.orientation.M

    def orientation_error_deg(self, R_vir: Array | None) -> float | None:
        """Return the angle from R_c to R_d, without the integral's trim; None while one is unknown."""
        M = self.M
        if R_vir is None or M is None or self.R_d is None:
            return None
        return rotation.angle_deg(self.R_d @ (R_vir @ M).T)

    @property
    def turned(self) -> float:
        """The share of the ramp that has passed, 0 to 1."""
        return 1.0 if self._ramp_s <= 0.0 else min(1.0, self._turned_s / self._ramp_s)

    def add_contact(self, finger: int, contact: TipContact, exposure_pose: HandPose) -> None:
        """Take the contact of one finger's valid frame with the hand's pose at its exposure (pairs Eq. 15).

        Raises FrameError when the tips' centres defined no virtual frame at that moment.
        """
        self._force.note(finger, contact)
        if self.gait is not None:
            self.gait.note_contact(finger, contact.in_contact)
        self._note_friction(finger, contact)
        if not contact.in_contact or contact.position_mm is None:
            if self.gait is None:
                self.orientation.without_contact(finger, contact.exposed_at_us)
            if self.pose_law is not None:
                self.pose_law.release(finger)
            return
        normal = contact_normal(exposure_pose, finger, contact.position_mm)
        if normal is not None:
            R_vir_then = virtual_frame(exposure_pose.tip_centre_m)
            normal_in_vir = R_vir_then.T @ normal
            if self.gait is None:  # it follows no finger that takes hold of another face
                self.orientation.add(finger, normal_in_vir, contact.exposed_at_us, contact.position_mm)
            if self.pose_law is not None and self._still is None:
                radius95_rad = 1e-3 * (contact.radius95_mm or 0.0) / self.gains.tip_radius_m
                self.pose_law.add_contact(
                    finger, normal, exposure_pose, R_vir_then, contact.exposed_at_us, radius95_rad
                )

    def _note_friction(self, finger: int, contact: TipContact) -> None:
        """Estimate the tip's friction, and answer slip with more grip; slip of several tips is one slip.

        Before the object is held, tips slide as they take hold of it: this is no slip.
        """
        config, law = self._pose_config, self.pose_law
        if contact.slip_begins and not config.onset_reflex:
            contact = replace(contact, slip_begins=False)
        ratio = friction_ratio(contact, self.gains.tip_radius_m, config.tip_stiffness_N_m2)
        is_held = self.orientation.is_following if law is None else law.object is not None
        if not is_held or (self.gait is not None and self.gait.away == finger):
            self.friction[finger] = TipFriction(config.friction, ratio=ratio)
            return
        before = self.friction[finger]
        self.friction[finger] = after = before.after_contact(contact, ratio)
        if contact.slip and law is not None:
            law.note_slip()
        if law is None or not config.slip_reflex or after.slips == before.slips or self._still is not None:
            return
        if contact.received_at_us >= self._squeezed_until_us:
            self._squeezed_until_us = contact.received_at_us + ANSWER_US
            law.squeeze(finger, after.friction)

    @property
    def turn_waits(self) -> bool:
        """True while a turn rests, or is undone, because a tip has slipped and friction allows no more."""
        law = self.pose_law
        if law is None or law.object is None or not self._pose_config.slip_reflex:
            return False
        return law.pace < 1 and any(one.is_lowered for one in self.friction)

    def torque_Nm(
        self, mode: Mode, pose: HandPose, qdot_rad_s: Array, R_vir: Array | None, dt_s: float
    ) -> Array:
        """Return the joint torques (nq,), within every limit; zero unless the mode moves joints."""
        self.friction = [one.after_tick(dt_s) for one in self.friction]
        if self.pose_law is not None:
            if mode is Mode.HOLD and self.pose_law.object is not None:
                u = self._still_torque_Nm(self.pose_law, pose, qdot_rad_s, R_vir, dt_s)
                return limit_torque_Nm(u, pose.q_rad, self.gains)
            self._still = None
            if R_vir is not None and self._holds(self.pose_law, mode, pose, R_vir, dt_s):
                u = self._pose_torque_Nm(self.pose_law, mode, pose, qdot_rad_s, R_vir, dt_s)
                return limit_torque_Nm(u, pose.q_rad, self.gains)
            self.pose_law.drop()
            self._law_M = None
            if self.reorientation.is_under_way or self.gait is not None:
                was_done = not self.reorientation.is_under_way
                self._end_gait("" if was_done else NOT_HELD)
        if mode not in MOVING:
            return np.zeros(len(qdot_rad_s))
        if mode is Mode.RELEASE:
            self._hold_at_m = None
            grasp_N = grasp_force_N(pose.tip_centre_m, self.gains)
            u = force_torque_Nm(pose, qdot_rad_s, -RELEASE_RATIO * grasp_N, self.gains)
            return limit_torque_Nm(u, pose.q_rad, self.gains)
        R_d_vir = None
        if R_vir is not None and mode in (Mode.MANIPULATE, Mode.BLIND):
            if mode is Mode.MANIPULATE or self._blind_by_choice:
                self._advance(R_vir, dt_s)
            R_d_vir = self.R_d_vir
        if self._carries:
            self._hold_at_m = self._position_to_hold(mode, pose)
        regulation_N = None
        if self._force.is_on:
            grasp_N = grasp_force_N(pose.tip_centre_m, self.gains)
            regulation_N = self._force.tip_force_N(grasp_N, pose.tip_rotation, dt_s)
        u = joint_torque_Nm(pose, qdot_rad_s, R_vir, R_d_vir, self.gains, self._hold_at_m, regulation_N)
        return limit_torque_Nm(u, pose.q_rad, self.gains)

    def _holds(self, law: PoseLaw, mode: Mode, pose: HandPose, R_vir: Array, dt_s: float) -> bool:
        """Return whether the pose law moves the joints in this tick; it begins when it can.

        In GRASP it begins after control.settle_ms with references of every finger, in MANIPULATE at once.
        """
        if mode not in HELD:
            self._grasped_s = 0.0
            return False
        if law.object is not None:
            return True
        M = self.orientation.M if law.can_hold else None
        self._grasped_s = 0.0 if M is None else self._grasped_s + dt_s
        if M is None or (mode is Mode.GRASP and self._grasped_s < self._settle_s):
            return False
        law.hold(pose, R_vir, R_vir @ M, dt_s)
        return True

    def _pose_torque_Nm(
        self, law: PoseLaw, mode: Mode, pose: HandPose, qdot_rad_s: Array, R_vir: Array, dt_s: float
    ) -> Array:
        law.advance(pose, dt_s)
        self._pose, target = pose, law.target
        assert law.object is not None and target is not None
        friction = [self._pose_config.friction] * len(self.friction)
        if self._pose_config.slip_reflex:
            friction = [one.friction for one in self.friction]
        self._law_M = R_vir.T.dot(law.object.R)
        if self.gait is not None:
            lifted_Nm = self.gait.advance(law, pose, dt_s, rests=mode is Mode.BLIND)
            self.R_d = target.R
            return law.torque_Nm(pose, qdot_rad_s, friction, dt_s) + lifted_Nm
        if mode is Mode.MANIPULATE:
            self._advance(R_vir, law.pace * dt_s if self.turn_waits else dt_s)
            assert self.R_d is not None
            target.R = self.R_d
            target.follow_shift(self.turned)
        return law.torque_Nm(pose, qdot_rad_s, friction, dt_s)

    def _still_torque_Nm(
        self, law: PoseLaw, pose: HandPose, qdot_rad_s: Array, R_vir: Array | None, dt_s: float
    ) -> Array:
        """Return the torques (nq,) of HOLD with a held object: by joint angles alone.

        The law's estimate follows the object meanwhile; the law goes on from there, with the same load.
        """
        law.advance(pose, dt_s)
        assert law.object is not None
        if self._still is None:
            friction = [one.friction for one in self.friction]
            law.rest(friction)
            self.reorientation.give_up(law, HELD_STILL)
            self._still = joint_hold(pose.q_rad, friction, self.gains, dt_s)
        law.hold_here()
        self._law_M = None if R_vir is None else R_vir.T.dot(law.object.R)
        forces = law.still_forces(self._still.friction, dt_s)
        contacts, most_N, deeper_m = law.object.grip, law.most_grip_N, law.deeper_m
        return self._still.torque_Nm(pose, qdot_rad_s, contacts, forces, most_N, self.gains, deeper_m)

    def _position_to_hold(self, mode: Mode, pose: HandPose) -> Array | None:
        """Return the tips' centroid (3,) at the time when the object was first held; None while it is not."""
        is_held = mode in (Mode.MANIPULATE, Mode.BLIND) or self.orientation.is_following
        if not is_held or self._hold_at_m is not None:
            return self._hold_at_m if is_held else None
        return np.asarray(pose.tip_centre_m.mean(axis=0))

    def _advance(self, R_vir: Array, dt_s: float) -> None:
        """Advance the ramp by dt_s, back if negative, and compute R_d_vir, Eq. (15); neither in BLIND."""
        M = self.M
        if M is None:
            return
        if self._start is None:
            self._start = R_vir @ M
        turned_s = max(0.0, min(self._turned_s + dt_s, self._ramp_s))
        if self.R_d is None or not self._is_led or turned_s != self._turned_s:
            self.R_d = target_step(self._turn_rad, turned_s, self._ramp_s).dot(self._start)
        self._turned_s, self._is_led = turned_s, True
        desired = self.R_d
        if self._integral_per_s > 0.0:
            if self.turned >= 1.0:
                self._trim_rad = self._trim(self.R_d @ (R_vir @ M).T, dt_s)
            desired = rotation.exp(self._trim_rad) @ self.R_d
        self.R_d_vir = desired_virtual_frame(desired, M)

    def _trim(self, remaining: Array, dt_s: float) -> Array:
        """Return the integral of the remaining turn as a rotation vector (3,) of bounded length."""
        trim = self._trim_rad + self._integral_per_s * dt_s * rotation.log(remaining)
        return np.asarray(trim * min(1.0, TRIM_LIMIT_RAD / max(TRIM_LIMIT_RAD, float(np.linalg.norm(trim)))))


def gains_of(config: HandConfig) -> Gains:
    """Return the gains and limits of hand.toml as arrays in the order of q."""
    joints, control = config.joints, config.control
    return Gains(
        f_d_N=control.f_d_N,
        K_r=control.K_r,
        B_Nms_rad=np.array([joint.B_Nms_rad for joint in joints]),
        tip_radius_m=control.tip_radius_m,
        friction_ratio=control.friction_ratio,
        torque_limit_Nm=np.array([joint.torque_limit_Nm for joint in joints]),
        q_min_rad=np.array([joint.min_rad for joint in joints]),
        q_max_rad=np.array([joint.max_rad for joint in joints]),
        object_weight_N=control.object_weight_N,
        position_stiffness_N_m=control.position_stiffness_N_m,
        soft_limit_rad=control.soft_limit_rad,
        velocity_joints=control.velocity_joints or control.drives_follow is not Follows.TORQUE,
    )
