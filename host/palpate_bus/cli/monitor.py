"""``palpate-host bus monitor``."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from palpate_bus.cli.bus_options import BUS_OPTIONS, NODE, open_chosen_bus
from palpate_edge.common.errors import ConfigError

if TYPE_CHECKING:
    from palpate_bus.decode.device import Device
    from palpate_bus.logs.candump import LogRecord

FILE = click.Path(path_type=Path, dir_okay=False)
SERVICES = ("nmt", "sync", "time", "emcy", "tpdo", "rpdo", "sdo", "heartbeat", "lss", "other")


@click.command()
@BUS_OPTIONS
@click.option("--log", "log_path", type=FILE, help="Decode this log (candump, ASC, BLF) instead of a bus.")
@click.option(
    "--config", "config_path", type=FILE, help="Take the nodes' names and EDS files from hand.toml."
)
@click.option("--eds", "eds", multiple=True, metavar="NODE=FILE", help="EDS of a node; may be repeated.")
@click.option("--node", "nodes", multiple=True, type=NODE, help="Only frames of this node; may be repeated.")
@click.option("--service", "services", multiple=True, type=click.Choice(SERVICES), help="Only this service.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object per frame.")
@click.option("--count", type=click.IntRange(min=1), help="Stop after this many printed frames.")
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after this many seconds.")
def monitor(
    log_path: Path | None,
    config_path: Path | None,
    eds: tuple[str, ...],
    nodes: tuple[int, ...],
    services: tuple[str, ...],
    as_json: bool,
    count: int | None,
    duration_s: float | None,
    **bus: Any,
) -> None:
    """Print every frame decoded.

    PDOs are printed as named values with units; EMCY, SDO, NMT and heartbeats as text. The names come from
    EDS files. A node's EDS is given by the log's header, --config or --eds; otherwise nodes 0x10 to 0x1F are
    fingertips and, where no drive is named, nodes 1 to 15 drives.

    \b
    Examples:
      palpate-host bus monitor
      palpate-host bus monitor --node 0x10 --service tpdo --service emcy
      palpate-host bus monitor --log hand.log --json | jq .values
      palpate-host bus monitor --interface socketcan --channel can0 --eds 5=drive.eds
    """
    from palpate_bus.decode.decoder import Decoder, Service  # noqa: PLC0415 - not needed by `bus hub`
    from palpate_bus.decode.hand_nodes import usual_beside  # noqa: PLC0415
    from palpate_bus.decode.monitor_lines import Selection, json_line, line  # noqa: PLC0415

    selection = Selection(frozenset(nodes), frozenset(Service(service) for service in services))
    shown, begin_us = 0, None
    with _source(log_path, duration_s, bus) as (header, records):
        devices = _devices(header, config_path, eds)
        decoder = Decoder(devices, usual_beside(devices.values()))
        for record in records:
            begin_us = record.stamp_us if begin_us is None else begin_us
            decoded = decoder.decode(record)
            if selection.shows(decoded):
                click.echo(json_line(decoded) if as_json else line(decoded, begin_us))
                shown += 1
            if shown == count:
                break


def _devices(header: dict[str, str], config_path: Path | None, eds: tuple[str, ...]) -> dict[int, Device]:
    from palpate_bus.decode.device import Device, devices_of_header  # noqa: PLC0415
    from palpate_bus.decode.hand_nodes import read_hand_nodes  # noqa: PLC0415

    devices = devices_of_header(header)
    if config_path is not None:
        devices |= read_hand_nodes(config_path)
    for entry in eds:
        match = re.fullmatch(r"(0x[0-9a-fA-F]+|\d+)=(.+)", entry)
        node_id = int(match[1], 0) if match else 0
        if match is None or not 1 <= node_id <= 127:
            raise ConfigError(
                f"--eds {entry} is not NODE=FILE with a node id of 1 to 127: write for example"
                " 0x10=fingertip.eds"
            )
        devices[node_id] = Device(node_id, f"node 0x{node_id:02X}", Path(match[2]))
    return devices


@contextmanager
def _source(
    log_path: Path | None, duration_s: float | None, bus: dict[str, Any]
) -> Iterator[tuple[dict[str, str], Iterator[LogRecord]]]:
    """Yield header and records of a log, or an empty header and the records of the bus until a stop."""
    from palpate_bus.logs.log_files import read_any_log  # noqa: PLC0415

    if log_path is not None:
        log = read_any_log(log_path)
        end_us = None if duration_s is None else log.records[0].stamp_us + round(duration_s * 1e6)
        yield (
            dict(log.header.entries),
            (record for record in log.records if end_us is None or record.stamp_us < end_us),
        )
    else:
        with open_chosen_bus(bus, "monitor", duration_s) as records:
            yield {}, records
