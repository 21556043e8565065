"""``palpate-host bus scan`` and ``palpate-host bus sdo``: list nodes, read and write their objects."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate_bus.cli.bus_options import BUS_OPTIONS, NODE, chosen_bus
from palpate_edge.common.atomic_write import STANDARD_OUTPUT, write_atomically
from palpate_edge.common.errors import ConfigError

if TYPE_CHECKING:
    from palpate_bus.decode.device import Device
    from palpate_bus.master.scan import FoundNode

DIFFERS = 1
BOOT_S = 10.0
FILE = click.Path(path_type=Path, dir_okay=False)
TIMEOUT = click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.01, 60),
    default=1.0,
    show_default=True,
    help="Wait this long for a response, s.",
)
EDS = click.option(
    "--eds", "eds_path", type=FILE, help="The node's EDS; default: by its id, fingertip or CiA 402 drive."
)


@click.command()
@BUS_OPTIONS
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.01, 60),
    default=0.3,
    show_default=True,
    help="Wait this long for each response of a node, s.",
)
@click.option(
    "--listen",
    "listen_s",
    type=click.FloatRange(0),
    default=1.2,
    show_default=True,
    help="Listen this long for heartbeats, s.",
)
@click.option("--lss/--no-lss", default=True, help="Also search for nodes without an id.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per node.")
def scan(timeout_s: float, listen_s: float, lss: bool, as_json: bool, **bus: Any) -> None:
    """List the nodes with state, profile and identity.

    Nodes without an id are found by LSS fastscan.

    \b
    Examples:
      palpate-host bus scan
      palpate-host bus scan --interface socketcan --channel can0 --json
    """
    from palpate_bus.master.lss import find_unconfigured  # noqa: PLC0415
    from palpate_bus.master.scan import scan as scan_bus  # noqa: PLC0415
    from palpate_bus.master.session import master  # noqa: PLC0415
    from palpate_edge.common.progress import progress_bar  # noqa: PLC0415 - `bus hub` needs no canopen

    with master(chosen_bus(**bus), "scan") as network:
        with progress_bar("requesting 127 node ids") as progress:
            found = scan_bus(network, listen_s, timeout_s, progress)
        unconfigured = find_unconfigured(network) if lss else []
    if as_json:
        for node in found:
            click.echo(json.dumps(_as_dict(node)))
        for address in unconfigured:
            click.echo(json.dumps({"node": None, "lss_address": str(address)}))
        return
    _print_table(found)
    for address in unconfigured:
        click.echo(f"without a node id: {address}  (palpate-host bus lss set NODE --address {address})")


def _as_dict(node: FoundNode) -> dict[str, object]:
    keys = ("vendor", "product", "revision", "serial")
    head: dict[str, object] = {"node": node.node_id, "state": node.state, "profile": node.profile}
    return head | {"name": node.name} | dict(zip(keys, node.identity, strict=True)) | {"remark": node.remark}


def _print_table(found: list[FoundNode]) -> None:
    if not found:
        click.echo("no node responds: check the bit rate, the termination and the nodes' power supply")
        return
    rows: list[tuple[str, ...]] = [
        ("node", "state", "profile", "name", "vendor", "product", "revision", "serial", "")
    ]
    for node in found:
        identity = ["-" if number is None else f"{number:X}" for number in node.identity]
        rows.append(
            (
                f"0x{node.node_id:02X}",
                node.state or "-",
                node.profile or "-",
                node.name or "-",
                *identity,
                node.remark,
            )
        )
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    for row in rows:
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


@click.group()
def sdo() -> None:
    """Read and write a node's objects.

    An object is given by its index or by its name in the EDS.

    \b
    Examples:
      palpate-host bus sdo read 0x10 "Value of contact x"
      palpate-host bus sdo read 0x10 1018:4
      palpate-host bus sdo write 0x10 1017 250ms
      palpate-host bus nmt preop 0x10
      palpate-host bus sdo write 0x10 1010:1 save
      palpate-host bus sdo check 0x10
      palpate-host bus sdo restore 0x10
    """


@sdo.command()
@click.argument("node", type=NODE)
@click.argument("object_name", metavar="OBJECT")
@BUS_OPTIONS
@TIMEOUT
@EDS
@click.option("--block", is_flag=True, help="Use block transfer for small objects as well.")
@click.option("-o", "--output", type=FILE, help="Write the bytes to this file.")
def read(
    node: int,
    object_name: str,
    timeout_s: float,
    eds_path: Path | None,
    block: bool,
    output: Path | None,
    **bus: Any,
) -> None:
    """Read OBJECT (INDEX or INDEX:SUB in hexadecimal, or a name) of NODE.

    Exit status: 0 read, 2 unknown object, 6 the node aborts or does not respond.

    \b
    Examples:
      palpate-host bus sdo read 0x10 "Manufacturer device name"
      palpate-host bus sdo read 5 1021 --block -o drive.eds
    """
    from palpate_bus.master import sdo_access  # noqa: PLC0415
    from palpate_bus.master.session import master, sdo_client  # noqa: PLC0415

    device = _device(node, eds_path)
    key = sdo_access.find_object(device, object_name)
    with master(chosen_bus(**bus), "sdo") as network:
        data = sdo_access.read(sdo_client(network, node, timeout_s), node, device, key, block)
    if output is not None:
        write_atomically(output, data, ConfigError)
    shown = f"{len(data)} bytes in {output}" if output else _shown(device, key, data)
    name = device.name_of(key) if device else object_name
    click.echo(f"{name} = {shown}", err=output == STANDARD_OUTPUT)


@sdo.command()
@click.argument("node", type=NODE)
@click.argument("object_name", metavar="OBJECT")
@click.argument("value", required=False)
@BUS_OPTIONS
@TIMEOUT
@EDS
@click.option("--block", is_flag=True, help="Use block transfer for small objects as well.")
@click.option("--file", "file_path", type=FILE, help="Write this file's bytes.")
def write(
    node: int,
    object_name: str,
    value: str | None,
    timeout_s: float,
    eds_path: Path | None,
    block: bool,
    file_path: Path | None,
    **bus: Any,
) -> None:
    """Write VALUE to OBJECT of NODE.

    VALUE is a raw number, a number with the object's unit, text, or bytes as hex:0102.

    Exit status: 0 written, 2 unknown object or value out of range, 6 the node aborts or does not respond.

    \b
    Examples:
      palpate-host bus sdo write 0x10 "Producer heartbeat time" 250ms
      palpate-host bus sdo write 0x10 6125:1 zero
    """
    from palpate_bus.master import sdo_access  # noqa: PLC0415
    from palpate_bus.master.session import master, sdo_client  # noqa: PLC0415

    if (value is None) == (file_path is None):
        raise click.UsageError("give either VALUE or --file")
    device = _device(node, eds_path)
    key = sdo_access.find_object(device, object_name)
    data = file_path.read_bytes() if file_path else sdo_access.encode(device, key, value or "")
    with master(chosen_bus(**bus), "sdo") as network:
        sdo_access.write(sdo_client(network, node, timeout_s), node, device, key, data, block)
    shown = f"{len(data)} bytes of {file_path}" if file_path else _shown(device, key, data)
    click.echo(f"{device.name_of(key) if device else object_name} = {shown}: written")


@sdo.command()
@click.argument("node", type=NODE)
@BUS_OPTIONS
@TIMEOUT
@EDS
def check(node: int, timeout_s: float, eds_path: Path | None, **bus: Any) -> None:
    """Compare the PDOs of NODE with those of its EDS.

    Exit status: 0 equal, 1 they differ, 6 the node aborts or does not respond.

    \b
    Example:
      palpate-host bus sdo check 0x10
    """
    from palpate_bus.master.node_check import differences  # noqa: PLC0415
    from palpate_bus.master.sdo_access import read_number  # noqa: PLC0415
    from palpate_bus.master.session import master, sdo_client  # noqa: PLC0415

    device = _described(node, eds_path)
    with master(chosen_bus(**bus), "sdo") as network:
        client = sdo_client(network, node, timeout_s)
        found = list(differences(device, lambda key: read_number(client, node, device, key)))
    _report(device, found)


@sdo.command()
@click.argument("node", type=NODE)
@BUS_OPTIONS
@TIMEOUT
@EDS
def restore(node: int, timeout_s: float, eds_path: Path | None, **bus: Any) -> None:
    """Restore the communication parameters of NODE to its EDS.

    Writes "load" to 1011h:02, resets the node's communication and compares its PDOs with the EDS. Other
    parameters are kept. A running hand does not use the node until it has read it again.

    Exit status: 0 equal, 1 they differ, 6 the node aborts or does not respond.

    \b
    Example:
      palpate-host bus sdo restore 0x10
    """
    from palpate_bus.master.node_restore import restore as restore_node  # noqa: PLC0415
    from palpate_bus.master.session import master  # noqa: PLC0415

    device = _described(node, eds_path)
    with master(chosen_bus(**bus), "sdo") as network:
        found = restore_node(network, device, timeout_s, BOOT_S)
    _report(device, found)


def _report(device: Device, found: list[str]) -> None:
    """Print the differences from the EDS; exit with DIFFERS if there are any."""
    for difference in found:
        click.echo(difference)
    count = f"{len(device.pdos)} PDOs, {len(found)} differences"
    click.echo(f"node 0x{device.node_id:02X}: {count} from {device.eds.name}")
    if found:
        sys.exit(DIFFERS)


def _described(node: int, eds_path: Path | None) -> Device:
    device = _device(node, eds_path)
    if device is None:
        raise ConfigError(f"no EDS is known for node 0x{node:02X}: give --eds FILE")
    return device


def _shown(device: Device | None, key: tuple[int, int], data: bytes) -> str:
    return device.reading(key, data).text if device else data.hex(" ")


def _device(node: int, eds_path: Path | None) -> Device | None:
    from palpate_bus.decode.device import Device, usual_device  # noqa: PLC0415

    return Device(node, f"node 0x{node:02X}", eds_path) if eds_path else usual_device(node)
