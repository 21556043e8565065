"""The joint torques: grasping, Eqs. (9)-(11), and the turning of the object, Eqs. (13)-(14).

Readings of the paper: f_d is no force, tip i is pulled with f_d rho_i/(3 r) towards the tips' centroid at the
distance rho_i. Eq. (13) has no sum in print; u_at is the sum over the fingers of J_i^T F_di. The gain K_r is
one number: the paper's diag(3.5, 3.5, 3.5) is one too, and only then does the law not depend on how the
hand's frame is laid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_host import rotation
from palpate_host.hand import HandPose
from palpate_host.rotation import Array

SINE_LIMIT_RAD = math.radians(60.0)


@dataclass(frozen=True, slots=True)
class Gains:
    """What Tables 3 and 4 set, and the limits that real friction and real motors add.

    f_d_N: nominal grasping force. K_r: orientation gain. B_Nms_rad: (nq,) joint damping.
    tip_radius_m: r. friction_ratio: largest |F_di| over that finger's grasp force.
    torque_limit_Nm: (nq,) per joint. q_min_rad, q_max_rad: (nq,) joint range. object_weight_N,
    position_stiffness_N_m: see `carrying_force_N`.
    """

    f_d_N: float
    K_r: float
    B_Nms_rad: Array
    tip_radius_m: float
    friction_ratio: float
    torque_limit_Nm: Array
    q_min_rad: Array
    q_max_rad: Array
    object_weight_N: float = 0.0
    position_stiffness_N_m: float = 0.0


def grasp_force_N(tip_centre_m: Array, gains: Gains) -> Array:
    """(3, 3) force on each tip towards the centroid x_cp of the tips' centres, Eqs. (10)-(11)."""
    pull = gains.f_d_N / (3.0 * gains.tip_radius_m)
    return np.asarray(pull * (tip_centre_m.mean(axis=0) - tip_centre_m))


def rotation_error(R_vir: Array, R_d_vir: Array) -> Array:
    """Sum over the axes of r_vir x r_d_vir (3,): the axis of the turn still missing times 2 sin(angle).

    As printed (Eq. 14) it vanishes again at 180 degrees. Beyond 60 degrees it therefore goes on with the
    slope it has there, along the rotation's logarithm: continuous, growing up to half a turn.
    """
    missing = R_d_vir @ R_vir.T
    vector = rotation.log(missing)
    angle = float(np.linalg.norm(vector))
    if angle <= SINE_LIMIT_RAD:
        return 2.0 * rotation.axial(missing)
    return np.asarray(vector / angle * (2.0 * math.sin(SINE_LIMIT_RAD) + angle - SINE_LIMIT_RAD))


def orientation_force_N(tip_centre_m: Array, R_vir: Array, R_d_vir: Array, gains: Gains) -> Array:
    """(3, 3) F_di = omega_di x (x_ci - x_0), Eq. (14), scaled down to what friction bears.

    Print has l_di x omega_di with l_di pointing inwards, along axes n_i and a_i that are 0/0 at zero error.
    The two flips cancel: this form is identical and has no singularity; flipping one sign alone drives the
    object away.

    Friction: as printed |F_di|/|F_grasp| is 2 K_r sin(angle), 3.5 at 30 degrees. All three forces are scaled
    by one factor so that none exceeds friction_ratio of its grasp force; their sum stays zero and their
    moment its axis.
    """
    lever = tip_centre_m - tip_centre_m.mean(axis=0)
    omega = gains.f_d_N / (3.0 * gains.tip_radius_m) * gains.K_r * rotation_error(R_vir, R_d_vir)
    force = np.cross(omega, lever)
    size = np.linalg.norm(force, axis=1)
    allowed = gains.friction_ratio * np.linalg.norm(grasp_force_N(tip_centre_m, gains), axis=1)
    excess = float(np.max(size / np.maximum(allowed, 1e-12)))
    return np.asarray(force / max(1.0, excess))


def carrying_force_N(tip_centre_m: Array, hold_at_m: Array, gains: Gains) -> Array:
    """(3,) that each tip adds to carry the object: a third of its weight, up the hand's +z, and a third of a
    spring from the tips' centroid to `hold_at_m` (3,).

    Not in the paper, whose object has no weight and whose law no term in the position: a real one would sink.
    """
    pull = gains.position_stiffness_N_m * (hold_at_m - tip_centre_m.mean(axis=0))
    return np.asarray((pull + np.array([0.0, 0.0, gains.object_weight_N])) / len(tip_centre_m))


def joint_torque_Nm(
    pose: HandPose,
    qdot_rad_s: Array,
    R_vir: Array | None,
    R_d_vir: Array | None,
    gains: Gains,
    hold_at_m: Array | None = None,
) -> Array:
    """u (nq,) = u_sg + u_at, Eqs. (9), (10), (13), before the limits; grasp only without both frames.

    hold_at_m: where the tips' centroid is to stay with a grasped object, None: nothing is carried.
    """
    force = grasp_force_N(pose.tip_centre_m, gains)
    if hold_at_m is not None:
        force = force + carrying_force_N(pose.tip_centre_m, hold_at_m, gains)
    if R_vir is not None and R_d_vir is not None:
        force = force + orientation_force_N(pose.tip_centre_m, R_vir, R_d_vir, gains)
    forces_to_joints = np.einsum("iaj,ia->j", pose.tip_jacobian_m, force)
    return np.asarray(forces_to_joints - gains.B_Nms_rad * qdot_rad_s + pose.gravity_Nm)


def limit_torque_Nm(u_Nm: Array, q_rad: Array, gains: Gains) -> Array:
    """Clamp each joint's torque (nq,), and let none push further out of its joint's range."""
    u = np.clip(u_Nm, -gains.torque_limit_Nm, gains.torque_limit_Nm)
    outwards = ((q_rad >= gains.q_max_rad) & (u > 0.0)) | ((q_rad <= gains.q_min_rad) & (u < 0.0))
    return np.where(outwards, 0.0, u)


def target_step(full_step: Array, elapsed_s: float, ramp_s: float) -> Array:
    """The part of the rotation `full_step` asked for after `elapsed_s`: a linear ramp along one axis.

    A step at once asks for more tangential force than friction bears; a second or more of ramp does not.
    """
    share = 1.0 if ramp_s <= 0.0 else min(1.0, max(0.0, elapsed_s / ramp_s))
    return rotation.exp(share * rotation.log(full_step))
