"""``palpate-host setup``: a hand.toml from the nodes on the bus."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
import msgspec

from palpate_bus.cli.bus_options import BUS_OPTIONS, NODE
from palpate_bus.eds.cia402_axes import MAX_AXES
from palpate_bus.master.scan import FoundNode, scan
from palpate_bus.master.session import master, sdo_client
from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import ConfigError
from palpate_host.cli.check import reader
from palpate_host.cli.documents import EXAMPLES
from palpate_host.cli.setup_questions import ask_drives, ask_fingertips
from palpate_host.config import hand_reader
from palpate_host.config.hand_config import HandConfig
from palpate_host.service.hand_check import check_nodes, joint_angles, problem_count, table
from palpate_host.service.host import core_of, hand_of
from palpate_host.setup.found_nodes import DrivePlace, sort_nodes
from palpate_host.setup.hand_file import hand_toml, with_model, with_nodes, with_torque_limits
from palpate_host.setup.hand_text import fingers_text, top_view
from palpate_host.setup.model_fingers import GivenRange, fingers_of_model
from palpate_host.setup.node_requests import NodeRequests

DIFFERS = 1
LISTEN_S = 1.2  # longer than a node's heartbeat time
FILE = click.Path(path_type=Path, dir_okay=False)


class DriveParam(click.ParamType[DrivePlace]):
    """A drive: a node id, or NODE:AXIS."""

    name = "drive"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> DrivePlace:
        node, _, axis = str(value).partition(":")
        if axis and axis not in map(str, range(MAX_AXES)):
            self.fail(f"{value!r}: axis {axis} is not one of 0 to {MAX_AXES - 1}", param, ctx)
        return DrivePlace(NODE.convert(node, param, ctx), int(axis) if axis else None)


DRIVE = DriveParam()


@click.command()
@click.option("-o", "--output", type=FILE, default="hand.toml", show_default=True, help="File to write.")
@click.option(
    "--template",
    default="hand.toml",
    show_default=True,
    help="Hand that gives what the bus does not: a hand.toml, or a name of palpate-host example.",
)
@click.option(
    "--model", "model_path", type=FILE, help="URDF or MJCF of the hand, in place of the template's."
)
@click.option("--tip", "tips", multiple=True, help="A fingertip's site or link in --model; once for each.")
@click.option(
    "--range",
    "ranges",
    type=(str, float, float),
    multiple=True,
    help="JOINT MIN MAX: a joint's range in rad, in place of the model's; JOINT may be a pattern, 'J1_*'.",
)
@click.option("--fingertip", "fingertips", type=NODE, multiple=True, help="Once for each finger, in order.")
@click.option(
    "--drive",
    "drives",
    type=DRIVE,
    multiple=True,
    help="Once for each joint, in order; 0x01:2 is axis 2 of a node with several.",
)
@click.option("--picture", type=FILE, help="Drawing of the hand [default: OUTPUT with .svg].")
@click.option("--yes", is_flag=True, help="Ask nothing: nodes in the order of their ids.")
@click.option("--timeout", "timeout_s", type=click.FloatRange(0.01, 60), default=0.3, show_default=True)
@BUS_OPTIONS
def setup(
    output: Path,
    template: str,
    model_path: Path | None,
    tips: tuple[str, ...],
    ranges: tuple[tuple[str, float, float], ...],
    fingertips: tuple[int, ...],
    drives: tuple[DrivePlace, ...],
    picture: Path | None,
    yes: bool,
    timeout_s: float,
    interface: str,
    channel: str,
    bitrate: int | None,
) -> None:
    """Write hand.toml from the nodes on the bus, and draw the hand.

    The bus is scanned; fingertips and drives are identified by their objects. Each fingertip can flash its
    light, so that its finger can be given. The drive of a joint is found by turning the joint by hand; each
    axis of a node with several is a drive. This command moves nothing: no drive is enabled. Gains, limits and
    joint offsets come from the template; check them before the hand moves. Links and ranges come from the
    template or from a URDF or MJCF file. Where nodes have problems, the file is written only after a
    confirmation.

    \b
    Examples:
      palpate-host setup
      palpate-host setup --yes --interface socketcan --channel can0
      palpate-host setup --model my-hand.urdf --range "finger*_pip" 0.1 1.2

    Exit status: 0 written, 1 not written as nodes have problems, 2 the nodes do not fit the hand or the file
    exists, 6 the bus or a node does not respond.
    """
    from palpate_host.view.hand_picture import draw_hand  # noqa: PLC0415 - matplotlib takes half a second

    if output.exists():
        raise ConfigError(f"{output} exists: give another -o, or remove it first")
    draft = _draft(output, template, model_path, tips, [GivenRange(*one) for one in ranges])
    bus = BusConfig(interface=interface, channel=channel, bitrate=bitrate or draft.bus.bitrate)
    with master(bus, "setup") as network:
        found = scan(network, LISTEN_S, timeout_s)
        nodes = sort_nodes(found, draft.network.host_node)
        click.echo("\n".join(nodes.lines) or "no node responds")
        responding = {node.node_id for node in found if node.answers}
        clients = {node_id: sdo_client(network, node_id, timeout_s) for node_id in responding}
        read = reader(clients)
        requests = NodeRequests(clients, nodes, read)
        requests.refuse_enabled()
        tip_ids, chosen, directions = list(fingertips), list(drives), dict[DrivePlace, int]()
        if not tip_ids:
            tip_ids = _fingertips(nodes.fingertips, draft, requests, asks=not yes)
        if not chosen:
            chosen, directions = _drives(draft, requests, asks=not yes)
        on_bus = msgspec.structs.replace(bus, data_bitrate=requests.data_bitrate(tip_ids))
        config = with_nodes(draft, on_bus, tip_ids, chosen, directions)
        text = hand_toml(with_torque_limits(config, requests.torque_caps_Nm()))
        config = hand_reader.parse(output, text)
        hand = hand_of(config)
        core_of(config, hand)  # refuses what a host would refuse
        reports = list(check_nodes(config, read, config.node_names.keys() - responding))
    q_rad, is_measured = joint_angles(config, reports)
    tip_centre_m = hand.tip_centres_m(q_rad)
    for part in (table(reports), fingers_text(config, tip_centre_m, q_rad), top_view(tip_centre_m)):
        click.echo(part)
    picture = picture or output.with_suffix(".svg")
    title = "as it stands" if is_measured else "joints in the middle of their ranges"
    draw_hand(config, q_rad, picture, title)
    click.echo(f"{picture}: the hand drawn")
    wrong = problem_count(reports)
    if any(report.problems for report in reports) and (yes or not click.confirm(f"{wrong}: write {output}?")):
        click.echo(f"{output}: not written, as {wrong}")
        sys.exit(DIFFERS)
    write_atomically(output, text.encode(), ConfigError)
    click.echo(f"{output}: written; next: palpate-host run --config {output}")


def _draft(
    output: Path, template: str, model_path: Path | None, tips: Sequence[str], ranges: Sequence[GivenRange]
) -> HandConfig:
    """Return the template's hand, with the fingers of the model file if one is given."""
    draft = hand_reader.load(EXAMPLES[template][0] if template in EXAMPLES else Path(template))
    if model_path is None:
        return draft
    return with_model(
        draft, os.path.relpath(model_path, output.parent), fingers_of_model(str(model_path), tips, ranges)
    )


def _fingertips(
    nodes: Sequence[FoundNode], draft: HandConfig, requests: NodeRequests, *, asks: bool
) -> list[int]:
    """Return the node ids of the fingertips, finger by finger."""
    if not asks or len(nodes) != len(draft.fingers):
        return [node.node_id for node in nodes]
    return ask_fingertips(nodes, draft.fingers, partial(requests.flash, wait=time.sleep))


def _drives(
    draft: HandConfig, requests: NodeRequests, *, asks: bool
) -> tuple[list[DrivePlace], dict[DrivePlace, int]]:
    """Return the drives, joint by joint, and the directions found."""
    if not asks or len(requests.drives) != len(draft.joints):
        return requests.drives, {}
    return ask_drives(requests.drives, draft.joints, requests.angles_rad)
