"""[control] and [pose_law] of hand.toml: laws, gains and their limits."""

from __future__ import annotations

import enum
from typing import Annotated

import msgspec

from palpate_edge.common.config_file import Strict
from palpate_host.common.joint_command import Follows
from palpate_host.config.value_types import Milliseconds, NotNegative, Positive


class ControlMode(enum.Enum):
    """Which law turns the object: the paper's (contacts correct the frame) or Tahara's (blind)."""

    PROPOSED = "proposed"
    BLIND = "blind"


class ControlLaw(enum.Enum):
    """Law of a held object: the paper's, of its orientation, or that of its whole pose (pose_law.py)."""

    PAPER = "paper"
    POSE = "pose"


class ForceLaw(enum.Enum):
    """Effect of the measured contact force on the grasp (contact_force.py)."""

    OPEN = "open"
    INTEGRAL = "integral"
    ADMITTANCE = "admittance"


class ControlConfig(Strict, frozen=True):
    """Gains of Eqs. (9)-(14) (described at control.Gains) and how the object's orientation is followed.

    law: `pose` uses [pose_law] in place of K_r, friction_ratio, integral_per_s and the terms that carry.
    reference_frames: contacts a finger must give before its normal is a reference.
    contact_filter_s: low-pass on R_vir^T R_c; 0 turns it off. settle_ms: grasping before the object is
    turned. integral_per_s: rate at which the error that a proportional law leaves is taken out once the ramp
    is done; 0: as the paper. object_weight_N, position_stiffness_N_m: carry a grasped object, up is the
    hand's +z; 0: as the paper, whose object has no weight. release_ms: how long the fingers open after a
    release. velocity_joints: the drives turn with torque / B_d: u has then neither gravity nor damping.
    force_law, force_per_s: regulate the contact force, and how fast. soft_limit_rad: before the end of a
    joint's range the torque outwards fades. drives_follow: quantity that the drives follow; B_d_Nms_rad,
    speed_limit_rad_s, acceleration_limit_rad_s2: of velocity and position; torque_rate_Nm_s: of torque
    (drives/joint_orders.py).
    """

    mode: ControlMode
    tick_Hz: Annotated[int, msgspec.Meta(ge=10, le=1000)]
    f_d_N: Positive
    K_r: NotNegative
    tip_radius_m: Positive
    friction_ratio: Positive
    contact_filter_s: NotNegative
    reference_frames: Annotated[int, msgspec.Meta(ge=1, le=1000)]
    settle_ms: Milliseconds
    release_ms: Milliseconds = 500
    soft_limit_rad: NotNegative = 0.05
    velocity_joints: bool = False
    drives_follow: Follows = Follows.TORQUE
    B_d_Nms_rad: Positive = 0.4
    speed_limit_rad_s: Positive = 2.0
    acceleration_limit_rad_s2: Positive = 50.0
    torque_rate_Nm_s: Positive = 50.0
    force_law: ForceLaw = ForceLaw.OPEN
    force_per_s: NotNegative = 2.0
    integral_per_s: NotNegative = 0.0
    object_weight_N: NotNegative = 0.0
    position_stiffness_N_m: NotNegative = 0.0
    law: ControlLaw = ControlLaw.PAPER


class PoseLawConfig(Strict, frozen=True):
    """Gains and limits of control.law = "pose" (pose_law.py).

    position_stiffness_N_m, orientation_stiffness_Nm_rad: upper limits, which slow ticks reduce.
    position_damping_Ns_m, orientation_damping_Nms_rad: added to that of the joints. integral_per_s: rate at
    which a steady load is learned. friction: ratio of tangential to normal force that the grip provides for.
    most_grip_N: largest normal force of a tip that is commanded. relax_s: time constant with which the grip
    relaxes.
    contact_time_s: time constant with which contact normals correct the orientation. doubt_deg: a normal
    further from the expected one is left out. tip_stiffness_N_m2: k of Eq. (8), by which a loaded tip is
    smaller; 0: rigid. object_centre_mm: from the contacts' centroid to the point of the object that is kept
    in its place and about which the object turns, in the hand's frame when the hold begins. reach_mm,
    reach_deg: farthest target of a move from the pose where the hold began.
    slip_reflex: a tip that slips gets more grip, and its friction is estimated (tip_friction.py).
    onset_reflex: the same for a tip where slip begins, a flag that pushes with a sharp end set too.
    """

    position_stiffness_N_m: Positive = 1000.0
    position_damping_Ns_m: NotNegative = 20.0
    orientation_stiffness_Nm_rad: Positive = 4.0
    orientation_damping_Nms_rad: NotNegative = 0.03
    integral_per_s: NotNegative = 4.0
    friction: Positive = 0.4
    most_grip_N: Positive = 10.0
    relax_s: Positive = 0.5
    contact_time_s: Positive = 0.5
    doubt_deg: Positive = 8.0
    tip_stiffness_N_m2: NotNegative = 0.0
    object_centre_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    reach_mm: Positive = 20.0
    reach_deg: Positive = 45.0
    slip_reflex: bool = True
    onset_reflex: bool = False
