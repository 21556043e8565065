"""``palpate-host az``: AZ drives on RS-485 as CiA 402 nodes, and simulated ones to try it with."""

from __future__ import annotations

import logging
from contextlib import ExitStack, closing
from pathlib import Path

import click

from palpate_edge.can_bus.bus import open_bus
from palpate_edge.common.local_sockets.sd_notify import Notifier
from palpate_edge.common.logs import logging_to_stderr
from palpate_edge.common.plugins import load_part
from palpate_edge.common.signals import stop_event
from palpate_host.common.plugin_groups import SIMULATORS
from palpate_host.drives.az import config as az_config
from palpate_host.drives.az.gateway import run_gateway

_CONFIG = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="az.toml: ports, axes and the nodes they stand for (models/table4-az.toml is one).",
)


@click.group()
def az() -> None:
    """Oriental Motor AZ drives on RS-485.

    \b
    Examples:
      palpate-host az gateway --config az.toml      # AZ drives become CiA 402 nodes on the bus
      palpate-host az simulate --config az.toml     # no drives at hand: serves every port of az.toml
    """


@az.command()
@_CONFIG
def gateway(config_path: Path) -> None:
    """Serve each axis as a CiA 402 node until SIGTERM or SIGINT.

    The gateway disables the drives when it ends.

    \b
    Example:
      palpate-host az gateway --config az.toml
    """
    config = az_config.load(config_path)
    nodes = ", ".join(str(axis.drive_node) for port in config.ports for axis in port.axes)
    with (
        logging_to_stderr("az gateway"),
        stop_event() as stop,
        open_bus(config.bus, "az gateway") as bus,
        closing(Notifier()) as notifier,
    ):
        log = logging.getLogger("palpate.az")
        log.info("nodes %s on %d ports", nodes, len(config.ports))
        run_gateway(bus, config, stop, notifier)
        log.info("stopped, joints free")


@az.command()
@_CONFIG
def simulate(config_path: Path) -> None:
    """Simulate the drives of every port of az.toml.

    Each port's path becomes a symbolic link to the simulated serial line.

    \b
    Example:
      palpate-host az simulate --config az.toml
    """
    simulated_port = load_part(SIMULATORS, "az_port", "the simulated drive az_port")
    config = az_config.load(config_path)
    with stop_event() as stop, ExitStack() as stack:
        for port in config.ports:
            stack.enter_context(simulated_port(port))
        click.echo(f"simulated AZ drives: {', '.join(port.path for port in config.ports)}", err=True)
        stop.wait()
