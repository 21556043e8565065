"""Options shared by the commands that use a bus: the bus and the node."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from palpate_bus.hub.default_socket import default_socket
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.link import BUS_DATA_BITRATE
from palpate_edge.common.signals import stop_event

Command = TypeVar("Command", bound=Callable[..., Any])
SLICE_S = 0.1


class NodeId(click.ParamType[int]):
    """A node id, decimal or hexadecimal with 0x."""

    name = "node"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        try:
            number = int(str(value), 0)
        except ValueError:
            self.fail(f"{value!r} is not a node id: write for example 16 or 0x10", param, ctx)
        if not 1 <= number <= 127:
            self.fail(f"{value} is not a node id: give 1 to 127", param, ctx)
        return number


NODE = NodeId()


def BUS_OPTIONS(command: Command) -> Command:
    """Add --interface, --channel and --bitrate to a command; the default is the local hub."""
    options = (
        click.option(
            "--interface",
            default="palpate",
            show_default=True,
            help="Any python-can interface: palpate (the local hub), socketcan, slcan, ...",
        ),
        click.option(
            "--channel", default="", help="can0, path of the hub's socket, ...; default: the interface's."
        ),
        click.option("--bitrate", type=click.IntRange(10_000, 1_000_000), help="bit/s; default: the bus's."),
    )
    for option in reversed(options):
        command = option(command)
    return command


def chosen_bus(interface: str, channel: str, bitrate: int | None) -> BusConfig:
    """Return the options as a configuration, with CAN FD where the bus has it."""
    if interface == "palpate" and not channel:
        channel = str(default_socket())
    return BusConfig(
        interface=interface,
        channel=channel,
        bitrate=bitrate or 1_000_000,
        data_bitrate=BUS_DATA_BITRATE,
    )


@contextmanager
def open_chosen_bus(
    options: dict[str, Any], name: str, duration_s: float | None
) -> Iterator[Iterator[LogRecord]]:
    """Yield an iterator over the frames of the bus, which ends at SIGINT, SIGTERM or after the duration."""
    with open_bus(chosen_bus(**options), name) as bus, stop_event() as stopped:
        yield _frames(bus, stopped.is_set, duration_s)


def _frames(bus: Bus, stopped: Callable[[], bool], duration_s: float | None) -> Iterator[LogRecord]:
    end_s = None if duration_s is None else time.monotonic() + duration_s
    while not stopped() and (end_s is None or time.monotonic() < end_s):
        for stamp_us, frame in bus.receive(SLICE_S):
            yield LogRecord(stamp_us, frame)
