"""The execution of a planned turn: the object turns, or one finger lifts and takes hold again.

A finger takes hold again in five phases. UNLOAD shifts the internal forces to the others by the contacts'
shares (grasp_forces.py) within `SHIFT_S`. LIFT moves the tip along the old normal by the plan's clearance.
CARRY moves it straight to the place over the new contact. APPROACH moves it against the new normal until its
fingertip reports contact. LOAD shifts the internal forces back. A spring follows the tip's path, with the
joints' damping fed forward,

    u = J^T K (x_d - x_c) + B J^+ dx_d,

K limited as in stable_stiffness.py. The object's target stays meanwhile, and the pose law holds it with the
fingers whose share is not 0.

A gait rests while the supervisor is in doubt about a contact. It stops, with a reason, when a finger that
holds reports no contact in `LOST_FRAMES` frames, when a lifted tip is not free or finds no object, or when
the object does not follow. It then takes the present pose as its target, and the fingers that hold go on
holding.
"""

from __future__ import annotations

import enum
import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation, symmetric
from palpate_host.common.easing import eased
from palpate_host.common.gait_plan import GaitPlan, Regrasp, TurnTo
from palpate_host.control.gains import Gains
from palpate_host.control.holding.pose_law import PoseLaw
from palpate_host.control.holding.stable_stiffness import DELAY_TICKS, STABLE_SHARE
from palpate_host.control.kinematics import HandPose

TURN_RAD_S = math.radians(12.0)
SHIFT_S = 1.2
"""Time in which shares and stiffness change. In half of it the grip rises too fast, and moves the object."""
SETTLE_S, SETTLED_DEG, SETTLE_TIMEOUT_S = 0.3, 1.0, 3.0
LIFT_M_S, CARRY_M_S, APPROACH_M_S = 0.04, 0.10, 0.015
OVERTRAVEL_M = 0.006
"""Distance beyond the expected contact within which a tip looks for the object."""
FREE_TIMEOUT_S = 1.0
"""Time after LIFT within which the fingertip must report that it touches nothing."""
LOST_FRAMES = 3
TIP_STIFFNESS_N_M = 500.0
SINGULAR = 1e-6
"""Ratio of a tip's smallest mobility to its largest below which it counts as fixed in that direction."""
_SMOOTH = 1.5
"""Duration of a smooth step over that at constant speed: 3 s^2 - 2 s^3 has the largest slope 1.5."""


class GaitPhase(enum.Enum):
    """The phases of a gait."""

    TURN = "turn"
    UNLOAD = "unload"
    LIFT = "lift"
    CARRY = "carry"
    APPROACH = "approach"
    LOAD = "load"
    DONE = "done"
    STOPPED = "stopped"


class Gait:
    """The state of one turn by gaiting; call `advance` once a tick, before the pose law's torques.

    phase, reason: why it was stopped. away: the finger, from 0, that does not hold the object, also after a
    stop; None while all do. regrasped: how often a finger has taken hold again.
    """

    def __init__(self, plan: GaitPlan, law: PoseLaw, gains: Gains) -> None:
        """Begin. The object must be held; its faces in the plan replace the measured references."""
        assert law.object is not None and law.target is not None
        self.phase, self.reason = GaitPhase.TURN, ""
        self.away: int | None = None
        self.regrasped = 0
        self.R_d = self._R_start = law.target.R
        self._plan, self._gains = plan, gains
        self._per_B = 1.0 / np.maximum(gains.B_Nms_rad, 1e-6)
        self._number = -1
        self._since_s = self._duration_s = 0.0
        self._angle_rad = 0.0
        self._share = self._share_from = np.ones(len(plan.normals))
        self._from_m = self._to_m = self._touch_m = np.zeros(3)
        self._tip_d_m: Array | None = None
        self._depth_m = 0.0
        self._is_free = self._has_touched = False
        self._missed = [0] * len(plan.normals)
        self._before_stop = self.phase, 0.0, 0.0
        self._closes = False
        self._axis = np.array(plan.axis)
        self._goal_share = self._share_after = self._share
        self._normal = self._point_m = np.zeros(3)
        for finger, normal in enumerate(plan.normals):
            law.object.take_face(finger, np.array(normal))

    @property
    def is_over(self) -> bool:
        """True when the turn is done or was stopped."""
        return self.phase in (GaitPhase.DONE, GaitPhase.STOPPED)

    @property
    def _step(self) -> TurnTo | Regrasp | None:
        is_inside = 0 <= self._number < len(self._plan.steps)
        return self._plan.steps[self._number] if is_inside else None

    def note_contact(self, finger: int, in_contact: bool) -> None:
        """Take a valid frame of one finger."""
        self._missed[finger] = 0 if in_contact else self._missed[finger] + 1
        if finger != self.away:
            return
        if not in_contact:
            self._is_free = True
        elif self._is_free and self.phase is GaitPhase.APPROACH:
            self._has_touched = True

    def advance(self, law: PoseLaw, pose: HandPose, dt_s: float, *, rests: bool = False) -> Array:
        """Lead target and shares of the law on by one tick; return the torques (nq,) of the lifted finger.

        rests: target, shares and the lifted tip's path stay where they are.
        """
        if self._number < 0:
            self._next_step(law, pose, dt_s)
        self._look_for_loss(law)
        before_m = self._tip_d_m
        if not rests:
            self._lead_on(law, pose, dt_s)
        law.is_firm = not self.is_over
        assert law.object is not None and law.target is not None
        law.target.turn(self.R_d)
        law.object.set_share(self._share)
        return self._tip_torque_Nm(pose, before_m, dt_s)

    def _lead_on(self, law: PoseLaw, pose: HandPose, dt_s: float) -> None:
        self._since_s += dt_s
        act = {
            GaitPhase.TURN: self._turn,
            GaitPhase.UNLOAD: self._unload,
            GaitPhase.LIFT: self._lift,
            GaitPhase.CARRY: self._carry,
            GaitPhase.APPROACH: self._approach,
            GaitPhase.LOAD: self._load,
        }.get(self.phase)
        if act is not None:
            act(law, pose, dt_s)

    def _next_step(self, law: PoseLaw, pose: HandPose, dt_s: float) -> None:
        law.renew_stiffness(pose, dt_s, SHIFT_S)
        if self._closes:
            self._enter(GaitPhase.STOPPED, 0.0)
            self.reason = "gait stopped: ended by a command"
            return
        self._number += 1
        self._share_from = self._share
        step = self._step
        if step is not None:
            self._goal_share = np.array(step.share)
        if isinstance(step, TurnTo):
            self._enter(GaitPhase.TURN, _SMOOTH * (step.angle_rad - self._angle_rad) / TURN_RAD_S)
        elif isinstance(step, Regrasp):
            assert law.object is not None
            self._normal, self._point_m = np.array(step.normal), np.array(step.point_m)
            self._share_after = np.array(step.share_after)
            self._depth_m = self._gains.tip_radius_m - float(law.object.radius_m[step.finger])
            self._enter(GaitPhase.UNLOAD, SHIFT_S)
        else:
            self._enter(GaitPhase.DONE, 0.0)

    def _enter(self, phase: GaitPhase, duration_s: float) -> None:
        self.phase, self._since_s, self._duration_s = phase, 0.0, duration_s

    def close(self, law: PoseLaw) -> None:
        """Give up the turn; a lifted finger takes hold at its new place first, also after a stop."""
        if self.phase is GaitPhase.STOPPED:
            self.phase, self._since_s, self._duration_s = self._before_stop
        self.reason, self._missed = "", [0] * len(self._missed)
        self._closes = True
        law.hold_here()
        assert law.target is not None
        self.R_d = law.target.R

    def stop(self, law: PoseLaw, reason: str) -> None:
        """Stop with this reason; the present pose is the target, and the fingers that hold go on holding."""
        self._before_stop = self.phase, self._since_s, self._duration_s
        self._enter(GaitPhase.STOPPED, 0.0)
        self.reason = f"gait stopped: {reason}"
        law.hold_here()
        assert law.target is not None
        self.R_d = law.target.R

    def _look_for_loss(self, law: PoseLaw) -> None:
        for finger, missed in enumerate(self._missed):
            if missed >= LOST_FRAMES and finger != self.away and not self.is_over:
                self.stop(law, f"finger {finger + 1} lost the object")

    @property
    def _progress(self) -> float:
        """The smooth part of the phase that has passed, 0 to 1."""
        passed = 1.0 if self._duration_s <= 0.0 else min(1.0, self._since_s / self._duration_s)
        return eased(passed)

    def _shift_share(self, to: Array) -> float:
        """Lead the shares towards `to` within SHIFT_S of the phase; return the part that has passed."""
        passed = min(1.0, self._since_s / SHIFT_S)
        self._share = (1.0 - passed) * self._share_from + passed * to if passed < 1.0 else to
        return passed

    def _turn(self, law: PoseLaw, pose: HandPose, dt_s: float) -> None:
        step = self._step
        assert isinstance(step, TurnTo) and law.object is not None
        self._shift_share(self._goal_share)
        angle = self._angle_rad + self._progress * (step.angle_rad - self._angle_rad)
        self.R_d = rotation.exp(angle * self._axis) @ self._R_start
        over_s = self._since_s - max(self._duration_s, SHIFT_S)
        if over_s < SETTLE_S:
            return
        if rotation.angle_deg(self.R_d @ law.object.R.T) < SETTLED_DEG:
            self._angle_rad = step.angle_rad
            self._next_step(law, pose, dt_s)
        elif over_s > SETTLE_TIMEOUT_S:
            self.stop(law, "the object does not follow the turn")

    def _unload(self, law: PoseLaw, pose: HandPose, dt_s: float) -> None:
        step = self._step
        assert isinstance(step, Regrasp) and law.object is not None
        if self._shift_share(self._goal_share) < 1.0:
            return
        law.object.set_share(self._share)
        law.renew_stiffness(pose, dt_s)
        self._is_free = self._has_touched = False
        self.away = step.finger
        R, place_m = law.object.R, law.object.place_m
        self._tip_d_m = self._from_m = pose.tip_centre_m[step.finger]
        self._to_m = self._from_m + step.clearance_m * law.object.grip.normal[step.finger]
        self._touch_m = place_m + R @ (self._point_m + self._gains.tip_radius_m * self._normal)
        self._enter(GaitPhase.LIFT, _SMOOTH * step.clearance_m / LIFT_M_S)

    def _lift(self, law: PoseLaw, _pose: HandPose, _dt_s: float) -> None:
        step = self._step
        assert isinstance(step, Regrasp) and law.object is not None
        self._tip_d_m = self._from_m + self._progress * (self._to_m - self._from_m)
        if self._progress < 1.0:
            return
        self._from_m = self._to_m
        self._to_m = self._touch_m + step.clearance_m * (law.object.R @ self._normal)
        self._enter(GaitPhase.CARRY, _SMOOTH * rotation.norm(self._to_m - self._from_m) / CARRY_M_S)

    def _carry(self, law: PoseLaw, _pose: HandPose, _dt_s: float) -> None:
        step = self._step
        assert isinstance(step, Regrasp) and law.object is not None
        self._tip_d_m = self._from_m + self._progress * (self._to_m - self._from_m)
        if self._progress < 1.0:
            return
        if self._is_free:
            law.object.take_face(step.finger, self._normal)
            self._enter(GaitPhase.APPROACH, (step.clearance_m + OVERTRAVEL_M) / APPROACH_M_S)
        elif self._since_s > self._duration_s + FREE_TIMEOUT_S:
            self.stop(law, f"finger {step.finger + 1} still reports contact after it was lifted")

    def _approach(self, law: PoseLaw, pose: HandPose, _dt_s: float) -> None:
        step = self._step
        assert isinstance(step, Regrasp) and law.object is not None
        if self._has_touched:
            assert self._tip_d_m is not None
            self._share_from, self._from_m = self._share, self._tip_d_m
            centre_m = pose.tip_centre_m[step.finger]
            self._to_m = centre_m - self._depth_m * (law.object.R @ self._normal)
            self._enter(GaitPhase.LOAD, SHIFT_S)
            return
        if self._since_s > self._duration_s:
            self.stop(law, f"finger {step.finger + 1} found no object where it should take hold")
            return
        self._tip_d_m = self._to_m - self._since_s * APPROACH_M_S * (law.object.R @ self._normal)

    def _load(self, law: PoseLaw, pose: HandPose, dt_s: float) -> None:
        step = self._step
        assert isinstance(step, Regrasp)
        self._tip_d_m = self._from_m + self._progress * (self._to_m - self._from_m)
        if self._shift_share(self._share_after) < 1.0:
            return
        self._tip_d_m = self.away = None
        self.regrasped += 1
        self._missed[step.finger] = 0
        self._next_step(law, pose, dt_s)

    def _tip_torque_Nm(self, pose: HandPose, before_m: Array | None, dt_s: float) -> Array:
        """Return the torques (nq,) that lead the tip that lifts or takes hold."""
        step = self._step
        if self._tip_d_m is None or not isinstance(step, Regrasp):
            return np.zeros(len(pose.q_rad))
        J = pose.tip_jacobian_m[step.finger]
        damping, softest = self._tip_damping(J)
        K = min(TIP_STIFFNESS_N_M, STABLE_SHARE * softest / (DELAY_TICKS * dt_s))
        force_N = K * (self._tip_d_m - pose.tip_centre_m[step.finger])
        if before_m is not None:
            force_N += damping.dot((self._tip_d_m - before_m) / dt_s)
        return np.asarray(force_N.dot(J))

    def _tip_damping(self, J: Array) -> tuple[Array, float]:
        """Return (J B^-1 J^T)^+ (3, 3), the joints' damping of the tip, and its smallest value.

        J: (3, nq); the tip moves with its own finger's joints alone. A finger that cannot move its tip in
        every direction has a smallest value of 0.
        """
        (a, b, c), (_, d, e), (_, _, f) = (J * self._per_B).dot(J.T).tolist()
        if symmetric.determinant(a, b, c, d, e, f) > SINGULAR * (a + d + f) ** 3:
            return symmetric.inverse(a, b, c, d, e, f), 1.0 / symmetric.largest_eigenvalue(a, b, c, d, e, f)
        per_B = np.array([[a, b, c], [b, d, e], [c, e, f]])
        damping = np.linalg.pinv(per_B, rcond=SINGULAR, hermitian=True)
        return damping, max(0.0, float(np.linalg.eigvalsh(damping)[0]))
