"""The power state machine on the device's side of CiA 402 (CiA 402-2; IEC 61800-7-201)."""

from __future__ import annotations

from palpate_bus.eds.cia402 import DriveState

FAULT_RESET_BIT = 0x80

# Command pattern of the controlword: mask, value. CiA 402-2, table of commands.
SHUTDOWN = (0x87, 0x06)
SWITCH_ON = (0x8F, 0x07)
DISABLE_VOLTAGE = (0x82, 0x00)
QUICK_STOP = (0x86, 0x02)
ENABLE_OPERATION = (0x8F, 0x0F)

Command = tuple[int, int]

# State -> command -> next state; the numbers are those of the standard's transitions. Enable operation in
# READY_TO_SWITCH_ON passes through SWITCHED_ON (3, then 4).
TRANSITIONS: dict[DriveState, dict[Command, DriveState]] = {
    DriveState.SWITCH_ON_DISABLED: {SHUTDOWN: DriveState.READY_TO_SWITCH_ON},  # 2
    DriveState.READY_TO_SWITCH_ON: {
        SWITCH_ON: DriveState.SWITCHED_ON,  # 3
        ENABLE_OPERATION: DriveState.OPERATION_ENABLED,  # 3 and 4
        QUICK_STOP: DriveState.SWITCH_ON_DISABLED,  # 7
        DISABLE_VOLTAGE: DriveState.SWITCH_ON_DISABLED,  # 7
    },
    DriveState.SWITCHED_ON: {
        ENABLE_OPERATION: DriveState.OPERATION_ENABLED,  # 4
        SHUTDOWN: DriveState.READY_TO_SWITCH_ON,  # 6
        QUICK_STOP: DriveState.SWITCH_ON_DISABLED,  # 10
        DISABLE_VOLTAGE: DriveState.SWITCH_ON_DISABLED,  # 10
    },
    DriveState.OPERATION_ENABLED: {
        SWITCH_ON: DriveState.SWITCHED_ON,  # 5 (disable operation has the pattern of switch on)
        SHUTDOWN: DriveState.READY_TO_SWITCH_ON,  # 8
        DISABLE_VOLTAGE: DriveState.SWITCH_ON_DISABLED,  # 9
        QUICK_STOP: DriveState.QUICK_STOP_ACTIVE,  # 11
    },
    DriveState.QUICK_STOP_ACTIVE: {
        DISABLE_VOLTAGE: DriveState.SWITCH_ON_DISABLED,  # 12
        ENABLE_OPERATION: DriveState.OPERATION_ENABLED,  # 16
    },
}

# Bits 6, 5, 3, 2, 1, 0 of the statusword. CiA 402-2, table of state coding.
STATE_BITS = {
    DriveState.NOT_READY: 0x00,
    DriveState.SWITCH_ON_DISABLED: 0x40,
    DriveState.READY_TO_SWITCH_ON: 0x21,
    DriveState.SWITCHED_ON: 0x23,
    DriveState.OPERATION_ENABLED: 0x27,
    DriveState.QUICK_STOP_ACTIVE: 0x07,
    DriveState.FAULT_REACTION: 0x0F,
    DriveState.FAULT: 0x08,
}


class DriveStateMachine:
    """Power state and last controlword; the latter shows the rising edge of a fault reset."""

    def __init__(self) -> None:
        self.state = DriveState.SWITCH_ON_DISABLED  # transitions 0 and 1 are automatic
        self._last_controlword = 0

    def command(self, controlword: int, may_reset: bool = True) -> None:
        """Apply a controlword; one without a transition from this state changes nothing.

        may_reset: False while the cause of the fault persists; a reset then needs another rising edge.
        """
        rising = controlword & ~self._last_controlword
        self._last_controlword = controlword
        if self.state is DriveState.FAULT and rising & FAULT_RESET_BIT and may_reset:
            self.state = DriveState.SWITCH_ON_DISABLED  # 15
            return
        for (mask, value), state in TRANSITIONS.get(self.state, {}).items():
            if controlword & mask == value:
                self.state = state
                return

    def fail(self) -> None:
        """Enter Fault; the reaction, torque off, takes no time (transitions 13 and 14)."""
        self.state = DriveState.FAULT
