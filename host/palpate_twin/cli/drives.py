"""Command ``palpate-host drives``: the simulated joint drives of a hand on a bus."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.can_bus.bus import open_bus
from palpate_edge.common.signals import stop_event
from palpate_host.config import hand_reader
from palpate_host.drives.serve_devices import serve_devices, states_line
from palpate_twin.cli.options import config_option
from palpate_twin.drives.hand_drives import drives_of

TABLE_4_POSE_RAD = (0.0, 0.348, 1.221)


@click.command()
@config_option("hand.toml with the bus, and the node id and limits of each joint's drive.")
@click.option(
    "--pose-rad",
    type=(float, float, float),
    default=TABLE_4_POSE_RAD,
    show_default=True,
    help="Joint angles of a finger at which the load (the grasped object) exerts no torque.",
)
def drives(config_path: Path, pose_rad: tuple[float, float, float]) -> None:
    """Run a simulated CiA 402 drive for each joint until SIGTERM or SIGINT.

    \b
    Example (with the bus of hand.toml running):
      palpate-host drives --config hand.toml
    """
    config = hand_reader.load(config_path)
    simulated = drives_of(config, pose_rad)
    with stop_event() as stop, open_bus(config.bus, "drives") as bus:
        nodes = ", ".join(str(drive.slave.node_id) for drive in simulated)
        click.echo(f"simulated drives: nodes {nodes}", err=True)
        serve_devices(bus, simulated, stop)
    click.echo(f"simulated drives stopped: {states_line(simulated)}", err=True)
