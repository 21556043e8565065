"""Modes of operation of a CiA 402 drive (6060h, 6502h), which of them a hand uses, and what RPDO 1 carries.

RPDO 1 is controlword, mode and the target that the hand's drives follow; the EDS maps the target torque, for
the two others the master changes the mapping at start-up, so that each drive has one command PDO and one
watchdog.
"""

from __future__ import annotations

import enum

from palpate_edge.common.errors import BusError
from palpate_host.common.joint_command import Follows

CONTROLWORD = (0x6040, 0)
MODE = (0x6060, 0)
TARGET_TORQUE = (0x6071, 0)
TARGET_POSITION = (0x607A, 0)
TARGET_VELOCITY = (0x60FF, 0)

# Controlword and statusword bits whose meaning depends on the mode (CiA 402-2).
NEW_SET_POINT, CHANGE_AT_ONCE = 1 << 4, 1 << 5  # profile position
SET_POINT_TAKEN = 1 << 12
START_HOMING = 1 << 4  # homing
HOMING_ATTAINED, HOMING_ERROR = 1 << 12, 1 << 13


class OperationMode(enum.IntEnum):
    """Values of 6060h (CiA 402-2)."""

    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    PROFILE_TORQUE = 4
    HOMING = 6
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10

    @property
    def supported_bit(self) -> int:
        """The mode's bit of 6502h, which counts the modes from 1."""
        return 1 << (self.value - 1)


TARGETS = {
    Follows.TORQUE: TARGET_TORQUE,
    Follows.VELOCITY: TARGET_VELOCITY,
    Follows.POSITION: TARGET_POSITION,
}
COMMAND_MAPPING = {
    Follows.TORQUE: (0x60400010, 0x60600008, 0x60710010),
    Follows.VELOCITY: (0x60400010, 0x60600008, 0x60FF0020),
    Follows.POSITION: (0x60400010, 0x60600008, 0x607A0020),
}
"""Mapping words of RPDO 1."""

MODES_BEST_FIRST = {
    Follows.TORQUE: (OperationMode.CYCLIC_TORQUE, OperationMode.PROFILE_TORQUE),
    Follows.VELOCITY: (OperationMode.CYCLIC_VELOCITY, OperationMode.PROFILE_VELOCITY),
    Follows.POSITION: (OperationMode.CYCLIC_POSITION, OperationMode.PROFILE_POSITION),
}


def choose_mode(supported: int, follows: Follows) -> OperationMode:
    """Return the best mode of a drive with this 6502h for what it has to follow.

    Raises BusError, without the drive's name, when the drive has none.
    """
    for mode in MODES_BEST_FIRST[follows]:
        if supported & mode.supported_bit:
            return mode
    cyclic, profile = MODES_BEST_FIRST[follows]
    others = [
        other.value for other in Follows if any(supported & m.supported_bit for m in MODES_BEST_FIRST[other])
    ]
    remedy = f"set control.drives_follow to {' or '.join(others)}" if others else "use a drive that has one"
    raise BusError(
        f"lacks cyclic synchronous and profile {follows.value} (6502h is {supported:08X}h, bits"
        f" {cyclic - 1} and {profile - 1} are clear): {remedy}"
    )
