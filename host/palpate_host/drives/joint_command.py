"""What the controller asks of a joint and what a joint answers, whatever the drive behind it."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class DriveGoal(enum.Enum):
    """Where a drive shall be: without power, following torque, or braked by its own quick stop."""

    OFF = "off"
    TORQUE = "torque"
    QUICK_STOP = "quick stop"


@dataclass(frozen=True, slots=True)
class JointCommand:
    """One tick's order to one joint; the torque counts only with the goal TORQUE."""

    goal: DriveGoal
    torque_Nm: float = 0.0


@dataclass(frozen=True, slots=True)
class JointState:
    """A joint's measured state in the hand's sense of direction, stamped when its frame won the bus."""

    stamp_us: int
    position_rad: float
    velocity_rad_s: float
