"""NMT slave (CiA 301, 7.3.2): states, commands, boot-up."""

from __future__ import annotations

from enum import IntEnum

from palpate_edge.can_bus.can_frame import CanFrame

NMT_ID = 0x000
ERROR_CONTROL_ID = 0x700
HEARTBEAT_BYTES = 1


class NmtState(IntEnum):
    """NMT states with their codes in the heartbeat; a boot-up message contains INITIALISING."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(IntEnum):
    """Command specifiers of the NMT message."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


COMMANDS = {int(command): command for command in NmtCommand}

STATE_AFTER = {
    NmtCommand.START: NmtState.OPERATIONAL,
    NmtCommand.STOP: NmtState.STOPPED,
    NmtCommand.ENTER_PRE_OPERATIONAL: NmtState.PRE_OPERATIONAL,
    NmtCommand.RESET_NODE: NmtState.INITIALISING,
    NmtCommand.RESET_COMMUNICATION: NmtState.INITIALISING,
}

STATE_AFTER_ERROR = {0: NmtState.PRE_OPERATIONAL, 2: NmtState.STOPPED}
"""Value of 1029h:01 -> state after a communication error in OPERATIONAL; 1 is no change."""

SDO_STATES = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
"""The states in which SDO, EMCY, SYNC and TIME are served."""


def command_for(node_id: int, data: bytes) -> NmtCommand | None:
    """Return the command of an NMT message, None when it is for another node or unknown."""
    if len(data) != 2 or data[1] not in (0, node_id):
        return None
    return COMMANDS.get(data[0])


def boot_up(node_id: int) -> CanFrame:
    """Return the boot-up message, which a node sends once when it leaves INITIALISING."""
    return CanFrame(ERROR_CONTROL_ID + node_id, bytes([NmtState.INITIALISING]))
