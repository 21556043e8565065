"""Command to a joint and state of a joint, independent of its drive."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Follows(enum.Enum):
    """Quantity that a hand's drives follow (control.drives_follow in hand.toml).

    TORQUE: u itself. VELOCITY: the admittance qdot = u / B_d. POSITION: that velocity's integral.
    """

    TORQUE = "torque"
    VELOCITY = "velocity"
    POSITION = "position"


class DriveGoal(enum.Enum):
    """Goal of a drive: disabled, following a quantity, homing, or braked by its own quick stop."""

    OFF = "off"
    TORQUE = "torque"
    VELOCITY = "velocity"
    POSITION = "position"
    HOME = "home"
    QUICK_STOP = "quick stop"


@dataclass(frozen=True, slots=True)
class JointCommand:
    """One tick's order to one joint.

    torque_Nm: with the goal TORQUE what to follow; with VELOCITY and POSITION the most that may be used.
    velocity_rad_s, position_rad: count with the goal of their name.
    """

    goal: DriveGoal
    torque_Nm: float = 0.0
    velocity_rad_s: float = 0.0
    position_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class JointState:
    """A joint's measured state in the hand's sense of direction, stamped when its frame won the bus."""

    stamp_us: int
    position_rad: float
    velocity_rad_s: float
