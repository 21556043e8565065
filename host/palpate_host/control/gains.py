"""Gains and limits of the control laws, as arrays in the order of q."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.joint_command import Follows
from palpate_host.common.rows import Row
from palpate_host.config.hand_config import HandConfig


@dataclass(frozen=True, slots=True)
class Gains:
    """The gains of Tables 3 and 4, and the limits that real friction and real motors add.

    f_d_N: nominal grasping force. K_r: orientation gain. B_Nms_rad: (nq,) joint damping.
    tip_radius_m: r. friction_ratio: largest |F_di| over that finger's grasp force.
    torque_limit_Nm: (nq,) per joint. q_min_rad, q_max_rad: (nq,) joint range. soft_limit_rad: width of
    the zone before a range's end in which torque outwards fades. velocity_joints: joints turn with torque /
    B_d. object_weight_N, position_stiffness_N_m: see `carrying_force_N`.
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
    soft_limit_rad: float = 0.05
    velocity_joints: bool = False
    joint_rows: tuple[Row, ...] = field(init=False, repr=False, compare=False)
    """Range and torque limit of each joint in plain floats, for `limit_torque_Nm`."""

    def __post_init__(self) -> None:
        low, high, most = self.q_min_rad.tolist(), self.q_max_rad.tolist(), self.torque_limit_Nm.tolist()
        object.__setattr__(self, "joint_rows", tuple(zip(low, high, most, strict=True)))


def gains_of(config: HandConfig) -> Gains:
    """Return the gains and limits of hand.toml."""
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
