"""``palpate-host bus lss``: assign node ids to devices that have none."""

from __future__ import annotations

from typing import Any

import click

from palpate_bus.cli.bus_options import BUS_OPTIONS, NODE, chosen_bus


@click.group()
def lss() -> None:
    """Assign node ids to devices that have none (LSS, CiA 305).

    \b
    Examples:
      palpate-host bus lss list
      palpate-host bus lss set 0x11 --store
      palpate-host bus lss set 0x12 --address 0:404:10000:2A
    """


@lss.command("list")
@BUS_OPTIONS
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.01, 60),
    help="Wait this long for each response of a scan, s; default: 0.05, and 0.2 and 0.5 if that finds none.",
)
def list_(timeout_s: float | None, **bus: Any) -> None:
    """Print vendor:product:revision:serial of devices without id.

    The devices are found by fastscan. A response that comes too late spoils a scan, so a device on a busy
    computer needs a longer time.

    \b
    Examples:
      palpate-host bus lss list
      palpate-host bus lss list --timeout 2
    """
    from palpate_bus.master.lss import ANSWER_TIMEOUTS_S, find_unconfigured  # noqa: PLC0415
    from palpate_bus.master.session import master  # noqa: PLC0415

    with master(chosen_bus(**bus), "lss") as network:
        timeouts_s = ANSWER_TIMEOUTS_S if timeout_s is None else (timeout_s,)
        found = find_unconfigured(network, lambda address: click.echo(str(address)), timeouts_s)
    click.echo(f"{len(found)} devices without a node id", err=True)


@lss.command("set")
@click.argument("node", type=NODE)
@BUS_OPTIONS
@click.option("--address", help="vendor:product:revision:serial; default: the only device without an id.")
@click.option("--store", is_flag=True, help="Store the id in the device, so that it keeps it without power.")
def set_(node: int, address: str | None, store: bool, **bus: Any) -> None:
    """Assign the id NODE to a device.

    Exit status: 0 assigned, 6 the device does not respond or rejects the id.

    \b
    Examples:
      palpate-host bus lss set 0x11 --store
      palpate-host bus lss set 0x12 --address 0:404:10000:2A
    """
    from palpate_bus.master.lss import only_unconfigured, parse_address, set_node_id  # noqa: PLC0415
    from palpate_bus.master.session import master  # noqa: PLC0415

    with master(chosen_bus(**bus), "lss") as network:
        device = parse_address(address) if address else only_unconfigured(network)
        set_node_id(network, device, node, store)
    click.echo(f"{device} has node id 0x{node:02X}{', stored' if store else ''}")
