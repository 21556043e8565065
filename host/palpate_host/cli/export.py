"""``palpate-host export``: a bus log, or a file of status lines, for other tools."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import click

from palpate_edge.common.atomic_write import atomic_path
from palpate_edge.common.errors import ConfigError
from palpate_host.cli.run import CONFIG
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

FORMATS = (".mcap", ".csv", ".parquet")


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True))
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

    SOURCE is a bus log (candump, ASC, BLF), which is decoded and goes into the MCAP as an attachment; the
    file of `run --status`; a folder of `record`; or an MCAP of either. What a log lacks is printed and left
    empty.

    \b
    Examples:
      palpate-host export traffic.log --config hand.toml -o hand.mcap
      palpate-host export status.jsonl --config hand.toml -o hand.parquet
      palpate-host export recording/ --config hand.toml -o hand.csv
    """
    if output.suffix not in FORMATS:
        raise ConfigError(f"{output}: is none of {', '.join(FORMATS)}: end its name in one of them")
    config, hand = load_hand(config_path)
    statuses = read_statuses(source, config, hand, lambda line: click.echo(f"note: {line}", err=True))
    count = _write(output, statuses, config, hand, source)
    click.echo(f"{output}: {count} ticks of {config_path.name}")


def _write(
    output: Path, statuses: Iterable[HostStatus], config: HandConfig, hand: HandKinematics, source: Path
) -> int:
    """The number of ticks; what only one format needs is imported for it alone."""
    if output.suffix == ".csv":
        from palpate_host.recording.table import write_csv  # noqa: PLC0415

        return write_csv(output, statuses)
    if output.suffix == ".parquet":
        from palpate_host.recording.parquet import write_parquet  # noqa: PLC0415

        return write_parquet(output, statuses)
    from palpate_host.recording.mcap import McapRecording  # noqa: PLC0415

    count = 0
    fingers = [finger.name for finger in config.fingers]
    with atomic_path(output, ConfigError) as path, McapRecording(path, hand, fingers) as recording:
        for status in statuses:
            recording.write(status)
            count += 1
        if source.is_file() and source.suffix not in (".jsonl", ".mcap") and count:
            recording.attach(source.name, "application/octet-stream", source.read_bytes(), status.time_us)
    return count
