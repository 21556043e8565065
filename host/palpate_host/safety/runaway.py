"""Limits whose passing is a fault: contact force, joint torque, joint speed. Pure.

The controller never asks for that much (control.py clamps what it asks); these look at what comes back. A
geared drive under velocity command goes on closing on a hard object whatever it was asked in torque: without
the sensor's force the grasp passes 50 N within 3 s.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate_edge.common.arrays import Array
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.hand_config import JointConfig, LimitsConfig


def force_fault(name: str, contact: TipContact, limits: LimitsConfig) -> str:
    """Why this contact is a fault: its normal force or its shear is beyond the limit; empty: it is not.

    In doubt too: a fingertip that does not believe its frame may be pressed flat.
    """
    shear_N = (contact.shear_N[0] ** 2 + contact.shear_N[1] ** 2) ** 0.5
    force_N = max(contact.normal_force_N, shear_N)
    if force_N <= limits.contact_force_N:
        return ""
    return f"{name}: contact force {force_N:.1f} N, limits.contact_force_N is {limits.contact_force_N:g}"


def joint_fault(
    joints: Sequence[JointConfig], torque_Nm: Sequence[float], qdot_rad_s: Array, limits: LimitsConfig
) -> str:
    """The first joint whose drive reports more torque than `torque_ratio` times its limit, or that is faster
    than `joint_speed_rad_s`; empty when none does."""
    if float(abs(qdot_rad_s).max()) > limits.joint_speed_rad_s:
        fastest = int(abs(qdot_rad_s).argmax())
        return (
            f"{joints[fastest].name}: {abs(float(qdot_rad_s[fastest])):.1f} rad/s,"
            f" limits.joint_speed_rad_s is {limits.joint_speed_rad_s:g}"
        )
    for joint, torque in zip(joints, torque_Nm, strict=True):
        if abs(torque) > limits.torque_ratio * joint.torque_limit_Nm:
            return f"{joint.name}: its drive reports {torque:.2f} N m, its limit is {joint.torque_limit_Nm:g}"
    return ""
