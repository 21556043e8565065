"""The manipulation of the object: contacts and target in, desired virtual frame and joint torques out.

Keeps the state of Eqs. (9)-(16) from tick to tick, and nothing of the bus: the estimate M, the object's
desired orientation (turn_ramp.py), the pose law with the object that it holds, and the friction of the tips.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.gait_plan import GaitPlan
from palpate_host.common.mode import MOVING, Mode
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.contact_force import ContactForce
from palpate_host.control.control_law import (
    force_torque_Nm,
    grasp_force_N,
    joint_torque_Nm,
    limit_torque_Nm,
)
from palpate_host.control.gains import gains_of
from palpate_host.control.gait.gait import Gait
from palpate_host.control.gait.reorientation import Reorientation
from palpate_host.control.grip_friction import GripFriction
from palpate_host.control.holding.joint_hold import JointHold, joint_hold
from palpate_host.control.holding.pose_law import PoseLaw
from palpate_host.control.kinematics import HandPose
from palpate_host.control.object_orientation import ObjectOrientation, contact_normal
from palpate_host.control.turn_ramp import TurnRamp
from palpate_host.control.virtual_frame import virtual_frame

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
        self._force = ContactForce(len(config.fingers), control, config.staleness.freeze_ms * 1e-3)
        self._blind_by_choice = control.mode is ControlMode.BLIND
        self._carries = control.object_weight_N > 0.0 or control.position_stiffness_N_m > 0.0
        self._hold_at_m: Array | None = None
        integral_per_s = 0.0 if self._blind_by_choice else control.integral_per_s
        self.pose_law: PoseLaw | None = None
        if control.law is ControlLaw.POSE:
            self.pose_law = PoseLaw(control, config.pose_law, self.gains, len(config.fingers))
            integral_per_s = 0.0  # the law has its own
        self._ramp = TurnRamp(
            config.target.rpy_deg,
            config.target.ramp_s,
            integral_per_s,
            is_eased=control.law is ControlLaw.POSE,
        )
        self.friction = GripFriction(config.pose_law, len(config.fingers), self.gains.tip_radius_m)
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
        self._ramp.begin(rpy_deg, ramp_s)
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
        self._ramp.begin((0.0, 0.0, 0.0), 0.0)

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
        was_gaiting = self.gait is not None
        self.reorientation.end(problem)
        if was_gaiting:
            self._forget_normals()

    def _forget_normals(self) -> None:
        """Collect the contacts' references again: fingers have taken hold of other faces."""
        control = self._control
        fingers = len(self.friction.tips)
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
        self._ramp.forget()
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
        """The share of the turn that is desired by now, 0 to 1."""
        return self._ramp.share

    @property
    def R_d(self) -> Array | None:
        """The desired orientation (3, 3); None while nothing is desired."""
        return self._ramp.R_d

    @property
    def R_d_vir(self) -> Array | None:
        """The desired orientation (3, 3) of the virtual frame, Eq. (15); None while nothing is desired."""
        return self._ramp.R_d_vir

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
        """Estimate the tip's friction, and answer slip with more grip."""
        law = self.pose_law
        is_held = self.orientation.is_following if law is None else law.object is not None
        is_held &= self.gait is None or self.gait.away != finger
        is_new_slip = self.friction.note(finger, contact, is_held=is_held)
        if law is None or not is_held:
            return
        if contact.slip:
            law.note_slip()
        if is_new_slip and self._still is None and self.friction.takes_answer(contact.received_at_us):
            law.squeeze(finger, self.friction.tips[finger].friction)

    @property
    def turn_waits(self) -> bool:
        """True while a turn rests, or is undone, because a tip has slipped and friction allows no more."""
        law = self.pose_law
        return law is not None and law.object is not None and law.pace < 1 and self.friction.is_lowered

    def torque_Nm(
        self, mode: Mode, pose: HandPose, qdot_rad_s: Array, R_vir: Array | None, dt_s: float
    ) -> Array:
        """Return the joint torques (nq,), within every limit; zero unless the mode moves joints."""
        self.friction.recover(dt_s)
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
            M = self.M
            if M is not None and (mode is Mode.MANIPULATE or self._blind_by_choice):
                self._ramp.advance(R_vir, M, dt_s)
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
        friction = self.friction.provided
        self._law_M = R_vir.T.dot(law.object.R)
        if self.gait is not None:
            lifted_Nm = self.gait.advance(law, pose, dt_s, rests=mode is Mode.BLIND)
            self._ramp.lead_elsewhere(target.R)
            return law.torque_Nm(pose, qdot_rad_s, friction, dt_s) + lifted_Nm
        if mode is Mode.MANIPULATE:
            target.R = self._ramp.advance(R_vir, self._law_M, law.pace * dt_s if self.turn_waits else dt_s)
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
            friction = self.friction.estimates
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
