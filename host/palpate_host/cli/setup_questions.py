"""Questions of ``palpate-host setup``: the finger of each fingertip, the drive of each joint."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import click

from palpate_bus.master.scan import FoundNode
from palpate_edge.common.errors import BusError
from palpate_host.config.hand_config import FingerConfig, JointConfig
from palpate_host.setup.found_nodes import LEAST_TURN_RAD, DrivePlace, turned_drive

OPERATIONAL = "operational"


def ask_fingertips(
    nodes: Sequence[FoundNode], fingers: Sequence[FingerConfig], flash: Callable[[int], None]
) -> list[int]:
    """Return the node ids, one for each finger: each fingertip flashes its light, and its finger is asked.

    flash: flashes the light of a node; BusError when it has none.
    """
    if not click.confirm("flash the light of each fingertip, to see which finger it is on?", default=True):
        return [node.node_id for node in nodes]
    for number, finger in enumerate(fingers, start=1):
        click.echo(f"{number}: {finger.name}")
    node_of: dict[int, int] = {}
    for node in nodes:
        while node.node_id not in node_of.values():
            _flash(node, flash)
            question = f"0x{node.node_id:02X}: number of its finger, 0 flashes it again"
            number = click.prompt(question, type=click.IntRange(0, len(fingers)))
            if number in node_of:
                click.echo(f"finger {number} has 0x{node_of[number]:02X}")
            elif number:
                node_of[number] = node.node_id
    return [node_of[number] for number in sorted(node_of)]


def _flash(node: FoundNode, flash: Callable[[int], None]) -> None:
    if node.state == OPERATIONAL:
        click.echo(f"0x{node.node_id:02X} is OPERATIONAL, a hand may use it: its light is left alone")
        return
    try:
        flash(node.node_id)
    except BusError as error:
        click.echo(str(error))


def ask_drives(
    drives: Sequence[DrivePlace],
    joints: Sequence[JointConfig],
    angles_rad: Callable[[], Mapping[DrivePlace, float]],
) -> tuple[list[DrivePlace], dict[DrivePlace, int]]:
    """Return the drives, one for each joint, and the directions found: each joint is turned by hand.

    angles_rad: reads the angle of each drive.
    """
    left = list(drives)
    directions: dict[DrivePlace, int] = {}
    if not click.confirm("find the drive of each joint? The drives stay off; you turn the joints by hand"):
        return left, directions
    chosen: list[DrivePlace] = []
    for joint in joints:
        place, direction = _turned(joint.name, left, angles_rad)
        click.echo(f"{joint.name}: drive {place}, direction {direction}")
        directions[place] = direction
        chosen.append(place)
        left.remove(place)
    return chosen, directions


def _turned(
    joint: str, left: Sequence[DrivePlace], angles_rad: Callable[[], Mapping[DrivePlace, float]]
) -> tuple[DrivePlace, int]:
    """Return the drive among `left` that a person turns, and its direction, 1 or -1."""
    question = f"turn {joint} in its positive direction, then press Enter"
    while True:
        before_rad = angles_rad()
        click.prompt(question, default="", show_default=False)
        after_rad = angles_rad()
        turned = turned_drive({place: before_rad[place] for place in left if place in before_rad}, after_rad)
        if turned is not None:
            return turned
        click.echo(f"no drive that is left has turned by {LEAST_TURN_RAD} rad")
