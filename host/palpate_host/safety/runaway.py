"""Limits on measured quantities whose violation is a fault: contact force, joint torque, joint speed. Pure.

The controller never commands that much (control_law.py clamps its output); these limits check what is
measured. A geared drive under velocity command keeps closing on a hard object although little torque is
commanded: without the fingertips' force in the loop the grasp exceeds 50 N within 3 s.
"""

from __future__ import annotations

from collections.abc import Sequence

from palpate_edge.common.arrays import Array
from palpate_host.common.tip_contact import TipContact
from palpate_host.config.hand_config import JointConfig, LimitsConfig


def force_fault(name: str, contact: TipContact, limits: LimitsConfig) -> str:
    """Return the fault text when the contact's normal or shear force exceeds the limit; empty otherwise.

    Contacts that are not valid count too: a fingertip that rejects its frames may be pressed flat. A force
    that is not known exceeds nothing: the supervisor keeps such a hand from grasping.
    """
    x_N, y_N = contact.shear_N or (0.0, 0.0)
    force_N = max(contact.normal_force_N or 0.0, (x_N**2 + y_N**2) ** 0.5)
    if force_N <= limits.contact_force_N:
        return ""
    return f"{name}: contact force {force_N:.1f} N, limits.contact_force_N is {limits.contact_force_N:g}"


def joint_fault(
    joints: Sequence[JointConfig], torque_Nm: Sequence[float], qdot_rad_s: Array, limits: LimitsConfig
) -> str:
    """Return the fault text of the fastest joint beyond `joint_speed_rad_s`, else of the first joint whose
    drive reports more than `torque_ratio` times its torque limit; empty when there is none."""
    if float(abs(qdot_rad_s).max()) > limits.joint_speed_rad_s:
        fastest = int(abs(qdot_rad_s).argmax())
        return (
            f"{joints[fastest].name}: {abs(float(qdot_rad_s[fastest])):.1f} rad/s,"
            f" limits.joint_speed_rad_s is {limits.joint_speed_rad_s:g}"
        )
    for joint, torque in zip(joints, torque_Nm, strict=True):
        if abs(torque) > limits.torque_ratio * joint.torque_limit_Nm:
            return (
                f"{joint.name}: its drive reports {torque:.2f} N m,"
                f" torque_limit_Nm is {joint.torque_limit_Nm:g}"
            )
    return ""
