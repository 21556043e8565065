"""`palpate-host check`: hand.toml against the bus."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import click
from canopen.sdo.client import SdoClient

from palpate_bus.decode.device import Device, Key
from palpate_bus.master.scan import FoundNode
from palpate_bus.master.scan import scan as scan_bus
from palpate_bus.master.sdo_access import read_number
from palpate_bus.master.session import master, sdo_client
from palpate_edge.common.errors import BusError
from palpate_host.cli.run import CONFIG
from palpate_host.control.turning_stability import turning_gain
from palpate_host.service.hand_check import NodeReport, Read, check_nodes, joint_angles, problem_count, table
from palpate_host.service.host import core_of, load_hand

DIFFERS = 1


@click.command()
@CONFIG
@click.option("--picture", type=click.Path(path_type=Path, dir_okay=False), help="Draw the hand into it.")
@click.option("--timeout", "timeout_s", type=click.FloatRange(0.01, 60), default=0.3, show_default=True)
@click.option("--offline", is_flag=True, help="Check the file and draw; ask nothing of the bus.")
def check(config_path: Path, picture: Path | None, timeout_s: float, offline: bool) -> None:
    """Compare hand.toml with the nodes on its bus, while no host runs.

    Exit status: 0 when they agree, 1 when they differ.

    \b
    palpate-host check --config hand.toml
    palpate-host check --config hand.toml --picture hand.png
    palpate-host check --config hand.toml --offline --picture hand.png
    """
    config, hand = load_hand(config_path)
    core_of(config, hand)  # refuses what a host would refuse
    gain = turning_gain(config, hand)
    if gain is not None:
        at = f"at {gain.tick_Hz:g} ticks a second"
        click.echo(f"turning gain K_r f_d: {gain.margin:.3g} times as much is stable {at}")
        if not gain.is_stable:
            click.echo(f"warning: {gain.warning}")
    reports: list[NodeReport] = []
    if not offline:
        with master(config.bus, "check") as network:
            found = {node.node_id: node for node in scan_bus(network, 0.0, timeout_s)}
            clients = {node_id: sdo_client(network, node_id, timeout_s) for node_id in config.node_names}
            silent = {node for node in config.node_names if node not in found or not found[node].answers}
            reports = list(check_nodes(config, reader(clients), silent))
        _print(reports, found, set(config.node_names))
    if picture is not None:
        from palpate_host.view.hand_picture import draw_hand  # noqa: PLC0415 - matplotlib takes half a second

        q_rad, is_measured = joint_angles(config, reports)
        title = "as it stands" if is_measured else "joints in the middle of their ranges"
        draw_hand(config, q_rad, picture, title)
        click.echo(f"drawn: {picture}")
    if any(report.problems for report in reports):
        sys.exit(DIFFERS)


def reader(clients: Mapping[int, SdoClient]) -> Read:
    """Return a function that reads objects of nodes over SDO. clients: by node id."""

    def read(node_id: int, device: Device, key: Key) -> int | None:
        return read_number(clients[node_id], node_id, device, key)

    return read


def _print(reports: list[NodeReport], found: dict[int, FoundNode], expected: set[int]) -> None:
    click.echo(table(reports))
    for node_id, node in found.items():
        if node_id not in expected:
            click.echo(f"0x{node_id:02X} is on the bus and not in the file ({node.profile or 'no profile'})")
        elif node.answers > 1:
            raise BusError(f"{node.answers} nodes have the id 0x{node_id:02X}: give one another (bus lss)")
    click.echo(problem_count(reports))
