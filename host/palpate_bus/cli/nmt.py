"""``palpate-host bus nmt``: start, stop and reset nodes (CiA 301, 7.2.8)."""

from __future__ import annotations

import time
from typing import Any

import click

from palpate_bus.cli.bus_options import BUS_OPTIONS, NodeId, chosen_bus
from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import BusError
from palpate_edge.node.nmt import ERROR_CONTROL_ID, NMT_ID, NmtCommand, NmtState

ALL = 0
WAIT_NODE_S, WAIT_ALL_S = 30.0, 1.5
"""Time for heartbeats, s: a fingertip that was started just now needs seconds on a small board."""
COMMANDS = {
    "start": NmtCommand.START,
    "stop": NmtCommand.STOP,
    "preop": NmtCommand.ENTER_PRE_OPERATIONAL,
    "reset": NmtCommand.RESET_NODE,
}
REACHED = {
    NmtCommand.START: {NmtState.OPERATIONAL},
    NmtCommand.STOP: {NmtState.STOPPED},
    NmtCommand.ENTER_PRE_OPERATIONAL: {NmtState.PRE_OPERATIONAL},
    NmtCommand.RESET_NODE: {NmtState.INITIALISING, NmtState.PRE_OPERATIONAL},
}
"""States in the heartbeat, or boot-up, that show that a command was obeyed."""


class NodeOrAll(NodeId):
    """A node id, or ``all``."""

    name = "node|all"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        return ALL if value in ("all", ALL) else super().convert(value, param, ctx)


@click.command()
@click.argument("action", type=click.Choice(list(COMMANDS)))
@click.argument("node", type=NodeOrAll(), default=ALL)
@BUS_OPTIONS
@click.option(
    "--wait",
    "wait_s",
    type=click.FloatRange(0, 60),
    help="Wait this long for heartbeats, s; 0: only send [default: 30 for a node, 1.5 for all].",
)
def nmt(action: str, node: int, wait_s: float | None, **bus: Any) -> None:
    """Start, stop or reset nodes, and print their states.

    A node that starts up meanwhile gets the command again. A fingertip sends its contacts only after a start.
    The command enables no drive. A running palpate-host run starts its nodes itself; a stop of all nodes
    stops its hand.

    Exit status: 0 the nodes report the new state, 6 no heartbeat or another state.

    \b
    Examples:
      palpate-host bus nmt start 0x10
      palpate-host bus nmt stop all --interface socketcan --channel can0
      palpate-host bus nmt reset 0x10
    """
    command = COMMANDS[action]
    if wait_s is None:
        wait_s = WAIT_ALL_S if node == ALL else WAIT_NODE_S
    frame_out = CanFrame(NMT_ID, bytes((command, node)))
    states: dict[int, int] = {}
    with open_bus(chosen_bus(**bus), "nmt") as port:
        port.send([frame_out])
        end_s = time.monotonic() + wait_s
        while (left_s := end_s - time.monotonic()) > 0:
            for _, frame in port.receive(left_s):
                sender = frame.can_id - ERROR_CONTROL_ID
                if 1 <= sender <= 127 and len(frame.data) == 1 and node in (ALL, sender):
                    states[sender] = frame.data[0] & 0x7F
                    if sender == node and states[sender] not in REACHED[command]:
                        port.send([frame_out])
            if states.get(node) in REACHED[command]:
                break
    for sender, state in sorted(states.items()):
        click.echo(f"0x{sender:02X}: {_name(state)}")
    if not wait_s:
        return
    if not states:
        who = "all nodes" if node == ALL else f"node 0x{node:02X}"
        raise BusError(f"{who}: no heartbeat within {wait_s:g} s; list the nodes with palpate-host bus scan")
    others = [sender for sender, state in states.items() if state not in REACHED[command]]
    if others:
        names = ", ".join(f"0x{sender:02X}" for sender in others)
        raise BusError(
            f"{names}: state not reached after {action}: another master may command it (palpate-host run)"
        )


def _name(state: int) -> str:
    known = {int(one): one.name.lower().replace("_", "-") for one in NmtState}
    return known.get(state, f"state {state:02X}h")
