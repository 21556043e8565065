"""`palpate-host run`, `palpate-host replay` and `palpate-host contract`."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_host import host
from palpate_host.replay import contract_header, replay_to_log, write_output

CONFIG = click.option(
    "--config",
    "config_path",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="The hand's file; models/table4.toml in the package shows every key.",
)


@click.command()
@CONFIG
@click.option("--duration", "duration_s", type=click.FloatRange(min=0), help="Stop after so many seconds.")
@click.option(
    "--status",
    "status_target",
    type=click.Path(path_type=Path),
    help="Write the status of every tick as a JSON line to this file, named pipe or Unix socket.",
)
def run(config_path: Path, duration_s: float | None, status_target: Path | None) -> None:
    """Control the hand on its bus until SIGTERM, SIGINT or a fault.

    \b
    palpate-host run --config hand.toml
    palpate-host run --config hand.toml --duration 10 --status status.jsonl
    """
    host.run(config_path, duration_s, status_target)


@click.command()
@click.argument("log_path", metavar="LOG", type=click.Path(path_type=Path, dir_okay=False))
@CONFIG
@click.option(
    "-o",
    "--output",
    "output_path",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the frames the host answers with as a candump log.",
)
def replay(log_path: Path, config_path: Path, output_path: Path | None) -> None:
    """Feed a bus log through the host on a virtual clock; the same log gives the same frames.

    \b
    palpate-host replay demo.log --config hand.toml -o answers.log
    """
    config, hand = host.load_hand(config_path)
    result = replay_to_log(log_path, config, hand)
    if output_path is not None:
        write_output(output_path, result)
    modes = " ".join(mode.value for mode in result.modes)
    click.echo(f"{result.frames_in} frames in, {len(result.records)} frames out, modes: {modes}")
    if result.failure:
        click.echo(f"the hand stopped: {result.failure}")


@click.command()
@CONFIG
def contract(config_path: Path) -> None:
    """Print the options that bind a recorded bus log to this hand's EDS files and nodes.

    \b
    palpate-host bus hub --log hand.log $(palpate-host contract --config hand.toml)
    """
    config, _ = host.load_hand(config_path)
    for key, value in contract_header(config).entries.items():
        click.echo(f"--header {key}={value}")
