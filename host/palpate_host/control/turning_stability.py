"""Stability of the paper's turning force, Eqs. (13)-(14), at the hand's tick.

The turning force is a spring between R_vir and R_d_vir whose stiffness grows with K_r f_d. While tips roll,
Eq. (6), the object's velocity and spin xi (6,) move the joints by A xi with A = J_x^+ G^T. Along xi the
joints' damping resists with D = A^T B A, and the spring pulls with K = -A^T (du/dq) A. With a total delay
T, each eigenvalue k of D^-1 K is a loop k e^(-sT)/s that is unstable from k T = pi/2 on. T is 1.5 ticks: one
from the sample of the joint angles to the command, and half a tick for which the command is held.

An estimate for the pose in the middle of the joints' ranges, with each contact on the line from the tip's
centre to the tips' centroid. The inertia of hand and object makes the loop less stable, friction in the
drives makes it more stable; both are left out (docs/holding.md has the comparison with the twin).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.common.joint_command import Follows
from palpate_host.config.control_config import ControlLaw
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.control_law import orientation_force_N
from palpate_host.control.gains import Gains, gains_of
from palpate_host.control.holding.stable_stiffness import contact_jacobian_m, grasp_matrix
from palpate_host.control.holding.virtual_object import grip_of
from palpate_host.control.kinematics import HandKinematics, HandPose
from palpate_host.control.virtual_frame import virtual_frame

DELAY_TICKS = 1.5
ADVISED_MARGIN = 1.2
STEP = 1e-5
"""Step of the differences of du/dq along xi, in m and rad."""


@dataclass(frozen=True, slots=True)
class TurningGain:
    """The turning gain of a hand and its bound.

    margin: how many times larger K_r f_d, or the tick's period, may be before the loop is unstable.
    """

    f_d_N: float
    K_r: float
    tick_Hz: float
    margin: float

    @property
    def is_stable(self) -> bool:
        """True below the bound."""
        return self.margin > 1.0

    @property
    def warning(self) -> str:
        """The text that names the three ways out; empty while the gain is below its bound."""
        if self.is_stable:
            return ""
        share = self.margin / ADVISED_MARGIN
        return (
            f"the grasp may oscillate: control.f_d_N = {self.f_d_N:g} with K_r = {self.K_r:g} at"
            f" tick_Hz = {self.tick_Hz:g}: set f_d_N to {_down(share * self.f_d_N)} at most, or K_r to"
            f" {_down(share * self.K_r)} at most, or tick_Hz to {math.ceil(self.tick_Hz / share)} at least"
        )


def turning_gain(config: HandConfig, hand: HandKinematics) -> TurningGain | None:
    """Return the turning gain of the paper's law with its margin.

    None where the estimate does not apply: under another law, for joints without damping, and for drives that
    follow velocity or position, which have loops of their own.
    """
    control, gains = config.control, gains_of(config)
    follows_torque = control.drives_follow is Follows.TORQUE and not control.velocity_joints
    if control.law is not ControlLaw.PAPER or not follows_torque or not gains.B_Nms_rad.all():
        return None
    middle = np.array([(joint.min_rad + joint.max_rad) / 2 for joint in config.joints])
    try:
        fastest_per_s = fastest_rate_per_s(hand, middle, gains)
    except ConfigError:  # the tips are on one line there
        return None
    margin = math.inf
    if fastest_per_s > 0.0:
        margin = 0.5 * math.pi * control.tick_Hz / (DELAY_TICKS * fastest_per_s)
    return TurningGain(control.f_d_N, control.K_r, control.tick_Hz, margin)


def fastest_rate_per_s(hand: HandKinematics, q_rad: Array, gains: Gains) -> float:
    """Return the largest eigenvalue of D^-1 K at the joint angles (nq,). Raises FrameError."""
    pose = hand.pose(q_rad)
    R_d_vir = virtual_frame(pose.tip_centre_m)
    moved = _joint_motion(pose, gains.tip_radius_m)

    def turning_Nm(at_rad: Array) -> Array:
        there = hand.pose(at_rad)
        force_N = orientation_force_N(there.tip_centre_m, virtual_frame(there.tip_centre_m), R_d_vir, gains)
        return np.asarray(np.einsum("iak,ia->k", there.tip_jacobian_m, force_N))

    per_xi = [
        (turning_Nm(q_rad + STEP * way) - turning_Nm(q_rad - STEP * way)) / (2.0 * STEP) for way in moved.T
    ]
    D = moved.T @ (gains.B_Nms_rad[:, None] * moved)
    K = -moved.T @ np.array(per_xi).T
    return float(np.abs(np.linalg.eigvals(np.linalg.solve(D, K))).max())


def _joint_motion(pose: HandPose, tip_radius_m: float) -> Array:
    """Return A (nq, 6): the joints' velocities for the object's velocity and spin while the tips roll."""
    outward = pose.tip_centre_m - pose.tip_centre_m.mean(axis=0)
    normal = outward / np.linalg.norm(outward, axis=1, keepdims=True)
    grip = grip_of(pose.tip_centre_m, normal, np.full((len(normal), 1), tip_radius_m))
    J_x = contact_jacobian_m(pose, grip).reshape(3 * len(normal), -1)
    return np.asarray(np.linalg.pinv(J_x) @ grasp_matrix(grip).T)


def _down(value: float) -> str:
    """Return a bound with two digits after the point, rounded down."""
    return f"{math.floor(100.0 * value) / 100.0:g}"
