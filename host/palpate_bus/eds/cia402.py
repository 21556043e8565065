"""The CiA 402 drive profile as data: objects, states and commands (CiA 402-2; IEC 61800-7-201)."""

from __future__ import annotations

import enum
from pathlib import Path

CIA402_EDS = Path(__file__).with_name("cia402.eds")

STATUSWORD = (0x6041, 0)
MODE_DISPLAY = (0x6061, 0)
POSITION = (0x6064, 0)
VELOCITY = (0x606C, 0)
TORQUE = (0x6077, 0)


class DriveState(enum.Enum):
    """States of the CiA 402 power state machine, coded in the statusword."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"


# CiA 402-2, statusword: (mask, value, state).
_STATUSWORD = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY_TO_SWITCH_ON),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.OPERATION_ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)


class Controlword(enum.IntEnum):
    """Commands of the controlword; a rising edge of bit 7 resets a fault."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


def state_of(statusword: int) -> DriveState | None:
    """Return the state in a statusword, None for a pattern that the standard does not define."""
    return next((state for mask, value, state in _STATUSWORD if statusword & mask == value), None)
