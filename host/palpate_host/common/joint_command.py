"""What a tick asks of a joint and what a joint answers, whatever the drive behind it."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class Follows(enum.Enum):
    """What a hand's drives follow (control.drives_follow in hand.toml).

    TORQUE: u itself. VELOCITY: the admittance qdot = u / B_d. POSITION: that velocity's integral.
    """

    TORQUE = "torque"
    VELOCITY = "velocity"
    POSITION = "position"


class DriveGoal(enum.Enum):
    """Where a drive shall be: without power, following something, looking for its zero, or braked by its own
    quick stop."""

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
