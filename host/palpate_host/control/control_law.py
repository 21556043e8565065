"""The control law of the joint torques: grasping, Eqs. (9)-(11), and turning the object, Eqs. (13)-(14).

Readings of the paper: f_d is no force, tip i is pulled with f_d rho_i/(3 r) towards the tips' centroid at the
distance rho_i; with n fingers, of which the paper has three, the 3 is n. Eq. (13) has no sum in print; u_at
is the sum over the fingers of J_i^T F_di. The gain K_r is one number: the paper's diag(3.5, 3.5, 3.5) is one
too, and only then does the law not depend on how the hand's frame is laid.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common import rotation
from palpate_host.common.rows import Row
from palpate_host.control.gains import Gains
from palpate_host.control.kinematics import HandPose

SINE_LIMIT_RAD = math.radians(60.0)
COSINE_LIMIT = math.cos(SINE_LIMIT_RAD)
_Rows = list[Row]


def grasp_force_N(tip_centre_m: Array, gains: Gains) -> Array:
    """Return the force (n, 3) on each tip towards the centroid x_cp of the tips' centres, Eqs. (10)-(11)."""
    return np.asarray(-_pull_N_m(tip_centre_m, gains) * np.array(_levers_m(tip_centre_m)))


def _pull_N_m(tip_centre_m: Array, gains: Gains) -> float:
    return gains.f_d_N / (len(tip_centre_m) * gains.tip_radius_m)


def _levers_m(tip_centre_m: Array) -> _Rows:
    """Return the vectors from the centroid to each tip's centre.

    Plain floats: for nine numbers numpy's overhead exceeds the computation.
    """
    tips = tip_centre_m.tolist()
    share = 1.0 / len(tips)
    x0 = y0 = z0 = 0.0
    for x, y, z in tips:
        x0, y0, z0 = x0 + share * x, y0 + share * y, z0 + share * z
    return [(x - x0, y - y0, z - z0) for x, y, z in tips]


def rotation_error(R_vir: Array, R_d_vir: Array) -> Array:
    """Return the sum over the axes of r_vir x r_d_vir (3,): the axis of the remaining turn times 2
    sin(angle).

    As printed (Eq. 14) it vanishes again at 180 degrees. Beyond 60 degrees it therefore continues with its
    slope at 60 degrees, along the rotation's logarithm: continuous, growing up to half a turn.
    """
    return np.array(_rotation_error(R_vir, R_d_vir))


def _rotation_error(R_vir: Array, R_d_vir: Array) -> tuple[float, float, float]:
    missing = R_d_vir.dot(R_vir.T)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = missing.tolist()
    if 0.5 * (xx + yy + zz - 1.0) >= COSINE_LIMIT:
        return zy - yz, xz - zx, yx - xy
    x, y, z = rotation.log(missing).tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    per_rad = (2.0 * math.sin(SINE_LIMIT_RAD) + angle - SINE_LIMIT_RAD) / angle
    return per_rad * x, per_rad * y, per_rad * z


def orientation_force_N(tip_centre_m: Array, R_vir: Array, R_d_vir: Array, gains: Gains) -> Array:
    """Return F_di = omega_di x (x_ci - x_0) (n, 3), Eq. (14), scaled down to what friction can hold.

    Print has l_di x omega_di with l_di pointing inwards, along axes n_i and a_i that are 0/0 at zero error.
    The two flips cancel: this form is identical and has no singularity; flipping one sign alone drives the
    object away.

    Friction: as printed |F_di|/|F_grasp| is 2 K_r sin(angle), 3.5 at 30 degrees. All forces are scaled
    by one factor so that none exceeds friction_ratio of its grasp force; their sum stays zero and their
    moment its axis.
    """
    turning, share = _turning_levers_m(_levers_m(tip_centre_m), R_vir, R_d_vir, gains)
    return np.asarray(share * _pull_N_m(tip_centre_m, gains) * np.array(turning))


def _turning_levers_m(levers_m: _Rows, R_vir: Array, R_d_vir: Array, gains: Gains) -> tuple[_Rows, float]:
    """Return F_di divided by the pull, and the share of it that friction can hold.

    Grasp force and F_di are the pull times a lever, so the pull cancels from their ratio.
    """
    wx, wy, wz = _rotation_error(R_vir, R_d_vir)
    wx, wy, wz = gains.K_r * wx, gains.K_r * wy, gains.K_r * wz
    turning, excess = [], 0.0
    for x, y, z in levers_m:
        fx, fy, fz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
        turning.append((fx, fy, fz))
        ratio = (fx * fx + fy * fy + fz * fz) / (x * x + y * y + z * z + 1e-24)
        excess = ratio if ratio > excess else excess
    return turning, 1.0 / max(1.0, math.sqrt(excess) / gains.friction_ratio)


def carrying_force_N(tip_centre_m: Array, hold_at_m: Array, gains: Gains) -> Array:
    """Return the force (3,) that each tip adds to carry the object.

    Its share of the weight along the hand's +z, and of a spring from the tips' centroid to `hold_at_m` (3,).
    Not in the paper: its object has no weight and its law no position term, so a real object would sink.
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
    tip_force_N: Array | None = None,
) -> Array:
    """Return u (nq,) = u_sg + u_at, Eqs. (9), (10), (13), before the limits; u_sg alone without both frames.

    hold_at_m: the place of the tips' centroid with a grasped object, None when nothing is carried.
    tip_force_N: forces (n, 3) added to the tips (contact_force.py).
    """
    tips_m = pose.tip_centre_m
    levers_m, pull = _levers_m(tips_m), _pull_N_m(tips_m, gains)
    if R_vir is not None and R_d_vir is not None:
        turning, share = _turning_levers_m(levers_m, R_vir, R_d_vir, gains)
        along = share * pull
        rows = [
            (along * fx - pull * x, along * fy - pull * y, along * fz - pull * z)
            for (x, y, z), (fx, fy, fz) in zip(levers_m, turning, strict=True)
        ]
    else:
        rows = [(-pull * x, -pull * y, -pull * z) for x, y, z in levers_m]
    force = np.array(rows)
    if tip_force_N is not None:
        force = force + tip_force_N
    if hold_at_m is not None:
        force = force + carrying_force_N(tips_m, hold_at_m, gains)
    return force_torque_Nm(pose, qdot_rad_s, force, gains)


def force_torque_Nm(pose: HandPose, qdot_rad_s: Array, force_N: Array, gains: Gains) -> Array:
    """Return the sum over the tips of J_i^T F_i (nq,), less damping, plus gravity."""
    jacobian = pose.tip_jacobian_m
    forces_to_joints = force_N.ravel().dot(jacobian.reshape(-1, jacobian.shape[2]))
    return _with_damping_Nm(pose, qdot_rad_s, forces_to_joints, gains)


def contact_torque_Nm(
    pose: HandPose, qdot_rad_s: Array, force_N: Sequence[Row], moment_Nm: Sequence[Row], gains: Gains
) -> Array:
    """Return the sum of J_i^T F_i + J_wi^T m_i (nq,), less damping, plus gravity.

    moment_Nm: of the forces about the tips' centres, n rows each.
    """
    assert pose.jacobian is not None
    forces_to_joints = np.array([*force_N, *moment_Nm]).ravel().dot(pose.jacobian)
    return _with_damping_Nm(pose, qdot_rad_s, forces_to_joints, gains)


def _with_damping_Nm(pose: HandPose, qdot_rad_s: Array, forces_to_joints: Array, gains: Gains) -> Array:
    """Return torques (nq,) less damping, plus gravity.

    Without both for joints that turn with torque / B_d: their drives hold them up, and a torque against
    gravity would make them climb.
    """
    if gains.velocity_joints:
        return np.asarray(forces_to_joints)
    return np.asarray(forces_to_joints - gains.B_Nms_rad * qdot_rad_s + pose.gravity_Nm)


def limit_torque_Nm(u_Nm: Array, q_rad: Array, gains: Gains) -> Array:
    """Limit each joint's torque (nq,); outwards it fades to 0 over the last `soft_limit_rad` of the range."""
    soft_rad = max(gains.soft_limit_rad, 1e-9)
    limited = []
    for u, q, (low, high, most) in zip(u_Nm.tolist(), q_rad.tolist(), gains.joint_rows, strict=True):
        ahead_rad = high - q if u > 0.0 else q - low
        limit = most if ahead_rad >= soft_rad else most * max(ahead_rad, 0.0) / soft_rad
        limited.append(limit if u > limit else -limit if u < -limit else u)
    return np.array(limited)
