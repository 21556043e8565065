"""The torques of HOLD under the pose law: the last wrench and grip go on, and a stiffness holds the joints.

Contacts are too old, so only joint angles are used:

    u = sum J_xi^T f_i - K (q - q_d) - B dq/dt + g(q),        K = c B,        q_d = q_H - sum J_xi^+ d_i n_i.

q_H are the joint angles at the beginning of HOLD. f_i carry the wrench that the pose law commanded there,
without its damping, with a grip that becomes firm (PoseLaw.still_forces); their directions follow the object
as the rolling tips move it, Eq. (6). A firmer tip is pressed in by d_i more along its outward normal n_i, Eq.
(8), which must not pull at the stiffness. Forces with a stiffness of the joints are Salisbury's active
stiffness control (IEEE CDC 1980), in joint space.

Stability: with K = c B every motion that the contacts leave to the joints, dq = A dz, has the equation
A^T B A dz/dt = -c A^T B A z: each is the loop c e^(-sT)/s, for any contacts. c T = STABLE_SHARE
leaves a gain margin of pi (stable_stiffness.py); c is also limited by the inertia of hand and object, which
is not known. A joint without damping has no stiffness.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.control.control_law import contact_torque_Nm
from palpate_host.control.gains import Gains
from palpate_host.control.holding.grasp_forces import ContactForces
from palpate_host.control.holding.stable_stiffness import DELAY_TICKS, STABLE_SHARE, contact_jacobian_m
from palpate_host.control.holding.virtual_object import Grip, moment_rows
from palpate_host.control.kinematics import HandPose

MOST_RATE_PER_S = 25.0
"""Largest rate c = K/B; ticks slower than 100 Hz limit it further."""
SINGULAR = 1e-6


@dataclass(frozen=True, slots=True)
class JointHold:
    """The state at the beginning of HOLD: q_H (nq,), the diagonal of K (nq,), the friction of each tip."""

    q_rad: Array
    stiffness_Nm_rad: Array
    friction: Sequence[float]

    def torque_Nm(
        self,
        pose: HandPose,
        qdot_rad_s: Array,
        grip: Grip,
        forces: ContactForces,
        most_N: float,
        gains: Gains,
        deeper_m: Array,
    ) -> Array:
        """Return u (nq,) before the limits of the joints.

        grip, forces: the contacts and their forces. most_N: largest normal force of a tip; where the
        stiffness would exceed it, that finger's is scaled down. deeper_m: d_i (n,), by how much further each
        tip is pressed in than at the beginning.
        """
        J_x = contact_jacobian_m(pose, grip)
        inward_m = -deeper_m[:, None] * grip.normal
        q_d = self.q_rad + np.einsum("iqa,ia->q", np.linalg.pinv(J_x, rcond=SINGULAR), inward_m)
        spring_Nm = self.stiffness_Nm_rad * (q_d - pose.q_rad)
        spring_Nm = _bounded(spring_Nm, J_x, grip.normal, most_N - forces.normal_N)
        moments_Nm = moment_rows(grip.to_contact_m.tolist(), forces.rows_N)
        return spring_Nm + contact_torque_Nm(pose, qdot_rad_s, forces.rows_N, moments_Nm, gains)


def joint_hold(q_rad: Array, friction: Sequence[float], gains: Gains, dt_s: float) -> JointHold:
    """Return the hold of the joints at these angles (nq,). dt_s: time between ticks."""
    rate_per_s = min(STABLE_SHARE / (DELAY_TICKS * dt_s), MOST_RATE_PER_S)
    return JointHold(q_rad, rate_per_s * gains.B_Nms_rad, tuple(friction))


def _bounded(torque_Nm: Array, jacobian_m: Array, normal: Array, room_N: Array) -> Array:
    """Return torques (nq,) with which no tip presses with more than room_N (n,), at least 0.

    Scales those of a finger's joints. jacobian_m: (n, 3, nq) of the contacts. normal: (n, 3), outward.
    """
    bounded = torque_Nm.copy()
    for J, outward, room in zip(jacobian_m, normal, room_N.tolist(), strict=True):
        pressing_N = -float(outward.dot(np.linalg.pinv(J.T, rcond=SINGULAR).dot(torque_Nm)))  # f = (J^T)^+ u
        if pressing_N > room:
            bounded[np.any(J != 0.0, axis=0)] *= max(room, 0.0) / pressing_N
    return bounded
