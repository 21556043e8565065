"""``palpate-host export``: a bus log, or a file of status lines, for other tools."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import click
import msgspec

from palpate_edge.errors import ConfigError
from palpate_host.hand import Hand
from palpate_host.hand_config import HandConfig
from palpate_host.host import load_hand
from palpate_host.replay import read_bound_log, steps
from palpate_host.run_cli import CONFIG
from palpate_host.status import HostStatus

FORMATS = (".mcap", ".csv", ".parquet")


@click.command()
@click.argument("source", type=click.Path(path_type=Path, dir_okay=False, exists=True))
@CONFIG
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="File to write; its name ends in .mcap, .csv or .parquet.",
)
def export(source: Path, config_path: Path, output: Path) -> None:
    """Write what a hand did as MCAP (Foxglove), CSV or Parquet (columns as LeRobot names them).

    SOURCE is a bus log (candump, ASC, BLF), which is replayed through the host, or the file of
    `run --status`.

    \b
    Examples:
      palpate-host export traffic.log --config hand.toml -o hand.mcap
      palpate-host export status.jsonl --config hand.toml -o hand.parquet
    """
    if output.suffix not in FORMATS:
        raise ConfigError(f"{output}: is none of {', '.join(FORMATS)}: end its name in one of them")
    config, hand = load_hand(config_path)
    statuses = _statuses(source, config, hand)
    try:
        count = _write(output, statuses, config, hand)
    except ModuleNotFoundError as exc:
        raise ConfigError(f"{output}: needs {exc.name}: pip install 'palpate[record]'") from exc
    click.echo(f"{output}: {count} ticks of {config_path.name}")


def _write(output: Path, statuses: Iterable[HostStatus], config: HandConfig, hand: Hand) -> int:
    """The number of ticks; what only one format needs is imported for it alone."""
    if output.suffix == ".csv":
        from palpate_host.recording.table import write_csv  # noqa: PLC0415

        return write_csv(output, statuses)
    if output.suffix == ".parquet":
        from palpate_host.recording.parquet import write_parquet  # noqa: PLC0415

        return write_parquet(output, statuses)
    from palpate_host.recording.mcap import McapRecording  # noqa: PLC0415

    count = 0
    with McapRecording(output, hand, [finger.name for finger in config.fingers]) as recording:
        for status in statuses:
            recording.write(status)
            count += 1
    return count


def _statuses(source: Path, config: HandConfig, hand: Hand) -> Iterator[HostStatus]:
    if source.suffix == ".jsonl":
        yield from _read_status(source)
        return
    for step in steps(read_bound_log(source, config), config, hand):
        if step.output.status is not None and step.output.frames_out:
            yield step.output.status


def _read_status(source: Path) -> Iterator[HostStatus]:
    """The lines of a status file; a last line that was cut off by the end of the host is left out."""
    decoder = msgspec.json.Decoder(HostStatus)
    lines = source.read_bytes().splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        if number == len(lines) and not line.endswith(b"\n"):
            return
        try:
            yield decoder.decode(line)
        except msgspec.MsgspecError as exc:
            raise ConfigError(f"{source}, line {number}: is no status of the host ({exc})") from exc
