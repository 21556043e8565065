"""``palpate-host bus``: the hub, a logger, statistics, fault injection and log conversion for Wireshark."""

from __future__ import annotations

import logging
import signal
import time
from pathlib import Path

import click

from palpate_bus.cli.budget import budget
from palpate_bus.cli.check_eds import check_eds
from palpate_bus.cli.faults import fault_rule_options
from palpate_bus.cli.lss import lss
from palpate_bus.cli.monitor import monitor
from palpate_bus.cli.nmt import nmt
from palpate_bus.cli.nodes import scan, sdo
from palpate_bus.cli.stats_table import stats_table, status_line
from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import AskStatistics, ClearFaults, Inject, Statistics
from palpate_bus.hub.default_socket import default_socket
from palpate_bus.hub.faults import FaultRule
from palpate_bus.hub.server import Hub
from palpate_bus.logs.candump import LogHeader, LogRecord, LogWriter, read_log
from palpate_bus.logs.pcap import write_pcap
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.link import BUS_DATA_BITRATE
from palpate_edge.can_bus.simulated_clock import make_clock
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.logs import logging_to_stderr
from palpate_edge.common.signals import on_stop_signal, stop_event

hub_log = logging.getLogger("palpate.hub")

FILE = click.Path(path_type=Path, dir_okay=False)
SOCKET = click.option(
    "--socket",
    "socket_path",
    type=FILE,
    default=default_socket,
    show_default="$PALPATE_HUB, else palpate-hub.sock in $XDG_RUNTIME_DIR",
    help="The hub's Unix socket.",
)
HEADER = click.option(
    "--header",
    "header_entries",
    multiple=True,
    metavar="KEY=VALUE",
    help="Add a line to the log's header, such as origin=demo; may be repeated.",
)


@click.group()
def bus() -> None:
    """Inspect a CANopen bus, access its nodes, or run a local bus without CAN hardware.

    Exit status: 0 done, 1 differences or errors found (sdo check, check-eds, budget), 2 wrong argument or
    file, 6 the bus or a node does not respond.

    \b
    Examples:
      palpate-host bus hub --log hand.log             run a bus on this machine
      palpate-host bus scan                           list the nodes
      palpate-host bus nmt start 0x10                 start a node, so that it sends its contacts
      palpate-host bus monitor                        show all frames decoded
      palpate-host bus sdo read 0x10 1018:4           read one object
      palpate-host bus budget --fps 120               compute the bus load
    """


@bus.command()
@SOCKET
@HEADER
@click.option(
    "--bitrate",
    type=click.IntRange(0, 1_000_000),
    default=1_000_000,
    show_default=True,
    help="bit/s; 0: frames take no time.",
)
@click.option(
    "--data-bitrate",
    type=click.IntRange(1_000_000, 8_000_000),
    help="bit/s of the data phase of CAN FD frames; default: classic CAN only.",
)
@click.option(
    "--txqueuelen",
    type=click.IntRange(1, 4096),
    default=128,
    show_default=True,
    help="Length of each client's transmit queue; one more frame is refused with ENOBUFS.",
)
@click.option("--log", "log_path", type=FILE, help="Write all frames to this candump log.")
@click.option(
    "--clock",
    "clock_path",
    type=FILE,
    help="Create this clock file and use it; a simulated hand slows it down when the machine is too slow.",
)
def hub(
    socket_path: Path,
    header_entries: tuple[str, ...],
    bitrate: int,
    data_bitrate: int | None,
    txqueuelen: int,
    log_path: Path | None,
    clock_path: Path | None,
) -> None:
    """Run the hub until SIGTERM or SIGINT.

    At the end the hub logs one line of counters.

    Exit status: 0 stopped, 6 the socket cannot be created or another hub uses it.

    \b
    Examples:
      palpate-host bus hub
      palpate-host bus hub --socket /tmp/hand.sock --bitrate 500000 --log hand.log
      palpate-host bus hub --data-bitrate 5000000
    """
    clock = None if clock_path is None else make_clock(clock_path)
    server = Hub(socket_path, bitrate, txqueuelen, clock, data_bitrate)
    try:
        signal.set_wakeup_fd(server.wake_descriptor)
        with logging_to_stderr("hub"), on_stop_signal(server.stop):
            if log_path is not None:
                server.log = LogWriter(log_path, _header(header_entries))
            fd = f", CAN FD at {data_bitrate} bit/s" if data_bitrate else ""
            hub_log.info("listening at %s, %s bit/s%s", socket_path, bitrate or "unlimited", fd)
            server.run()
            hub_log.info(status_line(server.statistics()))
    finally:
        signal.set_wakeup_fd(-1)
        server.close()


@bus.command()
@SOCKET
@HEADER
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after this many seconds.")
@click.argument("log_path", metavar="LOG", type=FILE)
def log(socket_path: Path, header_entries: tuple[str, ...], duration_s: float | None, log_path: Path) -> None:
    """Write all frames to LOG in the format of candump -L.

    The command ends at SIGTERM, at SIGINT or after --duration.

    \b
    Example:
      palpate-host bus log hand.log --duration 10 --header origin=bench
    """
    config = BusConfig(interface="palpate", channel=str(socket_path), data_bitrate=BUS_DATA_BITRATE)
    end_s = None if duration_s is None else time.monotonic() + duration_s
    with (
        open_bus(config, "log") as port,
        LogWriter(log_path, _header(header_entries)) as writer,
        stop_event() as stopped,
    ):
        while not stopped.is_set() and (end_s is None or time.monotonic() < end_s):
            for stamp_us, frame in port.receive(0.2):
                writer.write(LogRecord(stamp_us, frame))
            writer.flush()
        click.echo(f"log: {port.counters.received} frames in {log_path}", err=True)


@bus.command()
@SOCKET
def stats(socket_path: Path) -> None:
    """Print bus load, clients, identifiers and faults.

    \b
    Example:
      palpate-host bus stats
    """
    reply = ask(socket_path, AskStatistics())
    if isinstance(reply, Statistics):
        click.echo(stats_table(reply))


@bus.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@click.argument("pcap_path", metavar="PCAP", type=FILE)
def pcap(log_path: Path, pcap_path: Path) -> None:
    """Convert LOG to a pcap file for Wireshark.

    \b
    Example:
      palpate-host bus pcap hand.log hand.pcap
      tshark -r hand.pcap -d can.subdissector,canopen
    """
    write_pcap(pcap_path, read_log(log_path).records)


@bus.group()
def fault() -> None:
    """Inject faults into the running hub, or clear them.

    \b
    Examples:
      palpate-host bus fault drop --id 0x190 --probability 0.1 --seed 7
      palpate-host bus fault delay --port finger-1 --delay-ms 5 --delay-max-ms 40
      palpate-host bus fault tx-full --port finger-1 --count 3
      palpate-host bus fault bus-off --port finger-1 --duration-ms 2000
      palpate-host bus fault clear
    """


@fault.command()
@SOCKET
def clear(socket_path: Path) -> None:
    """End every fault; bus-off ports become active again.

    \b
    Example:
      palpate-host bus fault clear
    """
    ask(socket_path, ClearFaults())


def _inject(socket_path: Path, rule: FaultRule) -> None:
    ask(socket_path, Inject(rule))


for _command in (budget, check_eds, lss, monitor, nmt, scan, sdo):
    bus.add_command(_command)

for _command in fault_rule_options(SOCKET, _inject):
    fault.add_command(_command)


def _header(entries: tuple[str, ...]) -> LogHeader:
    pairs = {}
    for entry in entries:
        key, equals, value = entry.partition("=")
        if not equals:
            raise ConfigError(f"--header {entry} is not KEY=VALUE: write for example origin=bench")
        pairs[key] = value
    return LogHeader(pairs)
