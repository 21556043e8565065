"""The NMT slave (CiA 301, 7.3.2): states, commands, boot-up."""

from __future__ import annotations

from enum import IntEnum

from palpate_edge.can_bus.can_frame import CanFrame

NMT_ID = 0x000
ERROR_CONTROL_ID = 0x700


class NmtState(IntEnum):
    """The states with the codes that a heartbeat carries; INITIALISING is what a boot-up says."""

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
"""1029h:01: where a communication error leads to from OPERATIONAL; 1 is no change."""

SDO_STATES = frozenset({NmtState.PRE_OPERATIONAL, NmtState.OPERATIONAL})
"""SDO, EMCY, SYNC and TIME are served in these states only."""


def command_for(node_id: int, data: bytes) -> NmtCommand | None:
    """The command that an NMT message gives this node; None when it is for another or none is known."""
    if len(data) != 2 or data[1] not in (0, node_id):
        return None
    return COMMANDS.get(data[0])


def boot_up(node_id: int) -> CanFrame:
    """The message that a node sends once when it leaves INITIALISING."""
    return CanFrame(ERROR_CONTROL_ID + node_id, bytes([NmtState.INITIALISING]))
