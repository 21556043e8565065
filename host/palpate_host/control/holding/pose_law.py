"""The law `pose`: a held object keeps its position and orientation, or follows a target pose.

The paper's law, Eqs. (9)-(16), controls the orientation alone. This law also controls the position:

1. virtual_object.py estimates place x and orientation R of the object, its velocity v and spin w.
2. Stiffness, damping and an integral give a wrench on the object, with e = x_d - x and p = log(R_d R^T):

       F = K_p e - D_p v + F_I,    dF_I/dt = k K_p e;        t = K_o p - D_o w + t_I,    dt_I/dt = k K_o p.

   Tahara, Arimoto and Yoshino (ICRA 2010) control the virtual object's pose by such a term on the tips'
   centroid; here x follows the contacts, so that rolling is no error. F_I and t_I learn any steady load,
   the object's weight first of all.
3. grasp_forces.py distributes the wrench to the contacts and adds the smallest grip that friction needs. The
   grip rises at once and relaxes slowly.
4. u = sum J_xi^T f_i - B dq/dt + g(q), Eqs. (9)-(10), with the contact's Jacobian J_xi = J_i - [x_i - x_ci]x
   J_wi: a force at the contact turns the tip as well, unlike one at its centre in Eq. (13).

stable_stiffness.py limits the gains by tick and damping.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.rows import ZERO, Row, bounded, cross, length, plus
from palpate_host.config.control_config import ControlConfig, PoseLawConfig
from palpate_host.control.control_law import contact_torque_Nm, grasp_force_N
from palpate_host.control.gains import Gains
from palpate_host.control.holding.grasp_forces import ContactForces, forces_within_cones, internal_ratio
from palpate_host.control.holding.pose_target import PoseTarget
from palpate_host.control.holding.pose_uncertainty import PoseUncertainty
from palpate_host.control.holding.stable_stiffness import Stiffness, stable_stiffness
from palpate_host.control.holding.virtual_object import Grip, VirtualObject, moment_rows
from palpate_host.control.kinematics import HandPose

FRAME_S = 1.0 / 30.0
"""Longest time that one contact may stand for in the correction of the orientation."""
VELOCITY_FILTER_S = 0.003
KNOWN_LOAD_N, KNOWN_LOAD_S, NEW_LOAD_N = 0.15, 0.3, 0.4
"""A load is known once less than this is missing for this time, and unknown again from the third on."""
SQUEEZE = 1.5
"""Factor by which the grip grows when a tip slips."""
FIRM = 2.0
"""Factor of the smallest grip while fingers lift in turn, whose transients then raise it no further, and of
the grip in HOLD."""
FIRMER_PER_S = 2.0
"""Rate at which that factor changes: faster changes of the grip push the object away."""
NARROW_RESERVE = 0.02
"""Friction ratio beyond the internal forces' below which a turn rests after a slip; below 0 it is undone."""


class PoseLaw:
    """The state of the law: references before the object is held, the virtual object from then on."""

    def __init__(self, control: ControlConfig, pose_law: PoseLawConfig, gains: Gains, fingers: int) -> None:
        self._control, self._config, self._gains = control, pose_law, gains
        self._seen: list[list[Array]] = [[] for _ in range(fingers)]
        self._seen95_rad = [0.0] * fingers
        self._was_released = [False] * fingers
        self._exposed_us = [0] * fingers
        self._object: VirtualObject | None = None
        self.stiffness: Stiffness | None = None
        self._stiffness_from = self._stiffness_to = None  # type: Stiffness | None
        self._change_s = self._changed_s = 0.0
        self.target: PoseTarget | None = None
        self.grip_N = self._least_grip_N = self._firm_N = 0.0
        self._rest_radius_m = np.zeros(fingers)
        self.is_firm, self._firmness = False, 1.0
        self.share = 1.0
        self.reserve = math.inf
        self.is_grip_at_limit = False
        self._force_I_N = self._torque_I_Nm = ZERO
        self._twist = np.zeros(6)
        self.uncertainty = PoseUncertainty()
        self.is_load_known = False
        self._still_s = 0.0

    @property
    def object(self) -> VirtualObject | None:
        """The estimate; None while the object is not held."""
        return self._object

    @property
    def load_N(self) -> Array:
        """The steady force (3,) that the law has learned to carry."""
        return np.array(self._force_I_N)

    @property
    def moved_mm(self) -> float:
        """The distance of the object from where the hold began."""
        if self._object is None or self.target is None:
            return 0.0
        return 1e3 * rotation.norm(self._object.place_m - self.target.origin_m)

    @property
    def place_error_mm(self) -> float | None:
        """The distance of the object's place from its present target; None while no object is held."""
        if self._object is None or self.target is None:
            return None
        return 1e3 * rotation.norm(self.target.place_m - self._object.place_m)

    @property
    def turned_deg(self) -> float:
        """The angle of the object from its orientation when the hold began."""
        if self._object is None or self.target is None:
            return 0.0
        return rotation.angle_deg(self._object.R @ self.target.origin_R.T)

    @property
    def orientation95_deg(self) -> float:
        """The 95 % radius of the object's orientation."""
        share = FRAME_S / self._config.contact_time_s
        return self.uncertainty.orientation95_deg(len(self._seen), self._control.reference_frames, share)

    @property
    def can_hold(self) -> bool:
        """True when every finger has given the references for its normal."""
        return all(len(seen) >= self._control.reference_frames for seen in self._seen)

    def add_contact(
        self,
        finger: int,
        normal: Array,
        pose: HandPose,
        R_vir: Array,
        exposed_us: int,
        radius95_rad: float = 0.0,
    ) -> None:
        """Take an outward normal (3,) of one finger, with hand and R_vir at its exposure.

        radius95_rad: the normal's 95 % radius, 0 where it is not known.
        """
        seen = self._seen[finger]
        seen.append(R_vir.T @ normal)
        del seen[: -self._control.reference_frames]
        self._seen95_rad[finger] = radius95_rad
        since_s = min(FRAME_S, max(0, exposed_us - self._exposed_us[finger]) * 1e-6)
        self._exposed_us[finger] = exposed_us
        if self._object is None:
            return
        share = min(1.0, since_s / self._config.contact_time_s)
        is_believed = self._object.correct(finger, normal, pose, share, radius95_rad)
        if is_believed:
            residual_rad = math.radians(self._object.residual_deg)
            self.uncertainty = self.uncertainty.after_normal(residual_rad)
        if not is_believed and self._was_released[finger]:
            self._object.touch_elsewhere(finger, normal, radius95_rad)
        self._was_released[finger] = False

    def release(self, finger: int) -> None:
        """Note a frame without contact: the finger's next contact may be on another face."""
        self._was_released[finger] = True
        if self._object is None:
            self._seen[finger].clear()

    def drop(self) -> None:
        """End the hold: the object is no longer followed, and its load is forgotten."""
        self._object = None
        self.target = None
        self._force_I_N = self._torque_I_Nm = ZERO

    def hold(self, pose: HandPose, R_vir: Array, R: Array, dt_s: float) -> None:
        """Begin to hold the object where it is; R is its orientation. Every finger must have references."""
        mean = np.array([np.mean(seen, axis=0) for seen in self._seen]) @ R_vir.T
        normal = mean / np.linalg.norm(mean, axis=1, keepdims=True)
        pull_N = np.linalg.norm(grasp_force_N(pose.tip_centre_m, self._gains), axis=1)
        self.grip_N = self._least_grip_N = float(pull_N.mean())
        radius_m = self._radius_m([self.grip_N] * len(normal))
        self._object = VirtualObject(pose, normal, R, radius_m, self._config.doubt_deg, self._seen95_rad)
        self._object.place_m = self._object.place_m + 1e-3 * np.array(self._config.object_centre_mm)
        self._twist = np.zeros(6)
        self.renew_stiffness(pose, dt_s)
        self.target = PoseTarget(self._object.place_m, R)
        self.uncertainty = PoseUncertainty()
        self.is_load_known, self._still_s = False, 0.0
        self.is_firm, self._firmness = False, 1.0

    def follow_point(self, place_m: Array) -> None:
        """Follow another point of the held object: the one that is now at (3,), which is to stay there."""
        assert self._object is not None and self.target is not None
        self.target.follow_point(place_m - self._object.place_m, place_m)
        self._object.place_m = place_m

    def renew_stiffness(self, pose: HandPose, dt_s: float, over_s: float = 0.0) -> None:
        """Compute the stable stiffness for the present pose and the fingers that hold the object.

        over_s: time over which it changes. A stiffness that rises at once pulls the more by what is missing.
        """
        assert self._object is not None
        found = self._object
        self._stiffness_from, self._change_s, self._changed_s = self.stiffness, over_s, 0.0
        self._stiffness_to = stable_stiffness(
            self._config, pose, found.grip, self._gains.B_Nms_rad, dt_s, found.place_m
        )
        if over_s == 0.0:
            self.stiffness = self._stiffness_to

    def _follow_stiffness(self, dt_s: float) -> Stiffness:
        """Return the stiffness of this tick, on its way to the one computed last."""
        goal = self._stiffness_to
        assert goal is not None
        if self.stiffness is goal:
            return goal
        self._changed_s += dt_s
        share = 1.0 if self._changed_s >= self._change_s else self._changed_s / self._change_s
        self.stiffness = (self._stiffness_from or goal).towards(goal, share)
        return self.stiffness

    def end_gait(self) -> None:
        """Hold with every finger alike, and no firmer than usual."""
        self.is_firm = False
        if self._object is not None:
            self._object.set_share(np.ones(len(self._seen)))

    def hold_here(self) -> None:
        """Take the present pose as the target."""
        if self._object is not None and self.target is not None:
            self.target.stay(self._object.place_m, self._object.R)

    def reachable_target(self, shift_m: Array, turn: Array) -> PoseTarget:
        """Return the target. Raises CommandError when, moved by (3,) and turned by (3, 3), it is beyond the
        workspace, and while no object is held."""
        if self.target is None:
            raise CommandError(
                "move is refused: the object is not held yet; wait until the grasp has settled"
            )
        self.target.check_reach(shift_m, turn, self._config)
        return self.target

    def advance(self, pose: HandPose, dt_s: float) -> None:
        """Follow the object for one tick; call it before `torque_Nm`."""
        if self._object is not None:
            self._object.advance(pose, dt_s)

    def note_slip(self) -> None:
        """Take a frame that flags slip: the place is less certain."""
        self.uncertainty = self.uncertainty.after_slip()

    def squeeze(self, finger: int, friction: float) -> None:
        """Answer a slip: the next tick's grip is larger, within `most_grip_N`, and relaxes as any other.

        friction: of the tip that slips. Far turned, internal forces alone may be beyond it: then no grip
        holds the tip, and one that rises pushes the object on.
        """
        if self._object is not None and internal_ratio(self._object.grip, finger) < friction:
            self.grip_N = max(self.grip_N, min(SQUEEZE * self.grip_N, self._config.most_grip_N))

    @property
    def pace(self) -> int:
        """Direction of the ramp after a slip: 1 while friction allows to turn on, else 0 or -1."""
        return 1 if self.reserve > NARROW_RESERVE else 0 if self.reserve > 0.0 else -1

    def torque_Nm(self, pose: HandPose, qdot_rad_s: Array, friction: Sequence[float], dt_s: float) -> Array:
        """Return u (nq,) before the limits. The object must be held. friction: of each tip."""
        found, config = self._object, self._config
        assert found is not None
        gains, grip = self._follow_stiffness(dt_s), found.grip
        pull_N, pull_Nm, more_N_s, more_Nm_s = self._pulls(gains)
        self._twist += dt_s / (dt_s + VELOCITY_FILTER_S) * (found.twist - self._twist)
        resist_N, resist_Nm = gains.dampers.dot(self._twist).reshape(2, 3).tolist()
        self._note_pull(length(pull_N), dt_s)
        most_N, most_Nm = self._most_load(grip, friction)
        if self.share >= 1.0:
            self._force_I_N = bounded(plus(self._force_I_N, more_N_s, dt_s), most_N)
            self._torque_I_Nm = bounded(plus(self._torque_I_Nm, more_Nm_s, dt_s), most_Nm)
        wanted_N = plus(plus(pull_N, resist_N, -1.0), self._force_I_N)
        force_N = bounded(wanted_N, most_N)
        torque_Nm = plus(plus(pull_Nm, resist_Nm, -1.0), self._torque_I_Nm)
        torque_Nm = bounded(plus(torque_Nm, self._moment_Nm(force_N)), most_Nm)
        least_N = self._least_now_N(dt_s)
        relaxed_N = least_N + max(0.0, self.grip_N - least_N) * math.exp(-dt_s / config.relax_s)
        forces = forces_within_cones(grip, force_N, torque_Nm, friction, relaxed_N, self.most_grip_N)
        self.grip_N, self.share, self.reserve = forces.grip_N, forces.share, forces.reserve
        self.is_grip_at_limit = self.share < 1.0 or wanted_N is not force_N
        found.set_radius(self._radius_m(forces.normals_N))
        moments_Nm = moment_rows(grip.to_contact_m.tolist(), forces.rows_N)
        return contact_torque_Nm(pose, qdot_rad_s, forces.rows_N, moments_Nm, self._gains)

    def _pulls(self, gains: Stiffness) -> tuple[Row, Row, Row, Row]:
        """Return the stiffness' force and torque, and the rates of the integrals' force and torque."""
        found, target = self._object, self.target
        assert found is not None and target is not None
        (x, y, z), (x_d, y_d, z_d) = found.place_m.tolist(), target.place_m.tolist()
        turned_rad = rotation.vector_of(target.R.dot(found.R.T))
        error = np.array((x_d - x, y_d - y, z_d - z, *turned_rad))
        pull_N, pull_Nm, more_N_s, more_Nm_s = gains.springs.dot(error).reshape(4, 3).tolist()
        return pull_N, pull_Nm, more_N_s, more_Nm_s

    def _moment_Nm(self, force_N: Row) -> Row:
        """Return the moment about the contacts' centroid of a force at the object's place."""
        assert self._object is not None
        arm_m = plus(self._object.place_m.tolist(), self._object.grip.centroid_m.tolist(), -1.0)
        return cross(arm_m, force_N)

    def rest(self, friction: Sequence[float]) -> None:
        """Take the present pose as the target, what pulls the object now as its load, and plan a firm grip.

        The object must be held. friction: of each tip.
        """
        found, gains = self._object, self.stiffness
        assert found is not None and gains is not None
        most_N, most_Nm = self._most_load(found.grip, friction)
        pull_N, pull_Nm, _, _ = self._pulls(gains)
        self._rest_radius_m = found.radius_m
        self._firm_N = max(self.grip_N, min(FIRM * self.grip_N, 0.5 * self._config.most_grip_N))
        self._force_I_N = bounded(plus(self._force_I_N, pull_N), most_N)
        self._torque_I_Nm = bounded(plus(self._torque_I_Nm, pull_Nm), most_Nm)
        self.hold_here()

    def still_forces(self, friction: Sequence[float], dt_s: float) -> ContactForces:
        """Return the contact forces that carry the load; pose and target do not count.

        Contacts show no push and no slip here, so the grip rises slowly to what `rest` has set for them.
        """
        self.grip_N = min(self.grip_N + FIRMER_PER_S * self._least_grip_N * dt_s, self._firm_N)
        found = self._object
        assert found is not None
        grip, force_N = found.grip, self._force_I_N
        torque_Nm = plus(self._torque_I_Nm, self._moment_Nm(force_N))
        torque_Nm = bounded(torque_Nm, self._most_load(grip, friction)[1])
        forces = forces_within_cones(grip, force_N, torque_Nm, friction, self.grip_N, self.most_grip_N)
        found.set_radius(self._radius_m(forces.normals_N))
        return forces

    @property
    def deeper_m(self) -> Array:
        """By how much further (n,) the tips are pressed in than at the last `rest`."""
        assert self._object is not None
        return self._rest_radius_m - self._object.radius_m

    @property
    def most_grip_N(self) -> float:
        """The largest normal force that a tip is commanded to press with."""
        return max(self._config.most_grip_N, self._least_grip_N)

    def _most_load(self, grip: Grip, friction: Sequence[float]) -> tuple[float, float]:
        """Return the largest force in N and torque in N m on the object."""
        most_N = min(friction) * grip.total_weight * self._config.most_grip_N
        return most_N, most_N * math.sqrt(grip.spread_m2 / grip.total_weight)

    def _least_now_N(self, dt_s: float) -> float:
        """Return the smallest grip of this tick; it changes slowly when the hold becomes firm."""
        goal = FIRM if self.is_firm else 1.0
        step = FIRMER_PER_S * dt_s
        self._firmness += min(max(goal - self._firmness, -step), step)
        most_N = max(0.5 * self._config.most_grip_N, self._least_grip_N)
        return min(self._firmness * self._least_grip_N, most_N)

    def _note_pull(self, pull_N: float, dt_s: float) -> None:
        """The load is known while the stiffness pulls little for a while: the integral carries it."""
        self._still_s = self._still_s + dt_s if pull_N < KNOWN_LOAD_N else 0.0
        if self._still_s >= KNOWN_LOAD_S:
            self.is_load_known = True
        elif pull_N > NEW_LOAD_N:
            self.is_load_known = False

    def _radius_m(self, normal_N: Sequence[float]) -> Array:
        """Return the tips' radii (n,) less their indentation, Eq. (8)."""
        radius_m, k = self._gains.tip_radius_m, self._config.tip_stiffness_N_m2
        if k == 0.0:
            return np.full(len(normal_N), radius_m)
        depths_m = [math.sqrt(one / k) if one > 0.0 else 0.0 for one in normal_N]
        return np.array([max(radius_m - depth_m, 0.5 * radius_m) for depth_m in depths_m])
