"""`palpate-host replay`: a bus log through the host, at once, at any speed, or key press by key press."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from palpate_bus.decode.decoder import Decoder
from palpate_bus.decode.monitor_lines import line
from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.progress import notes_beside
from palpate_host.cli.run import CONFIG
from palpate_host.config.hand_config import HandConfig
from palpate_host.service import host
from palpate_host.service.hand_devices import devices_of_hand
from palpate_host.service.recorded_replay import recorded_steps
from palpate_host.service.replay import Replay, ReplayStep, read_hand_log, replay_steps, steps, write_output

FILE = click.Path(path_type=Path, dir_okay=False)
KEYS = "space: next frame   t: to the end of the tick   m: to the next change of mode   q: quit"
GO_ON = "tm"


class Speed(click.ParamType[float]):
    """Speed relative to the recording; ``max`` is infinity."""

    name = "speed"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        try:
            speed = float("inf") if value == "max" else float(value)
        except ValueError:
            self.fail(f"{value!r} is no speed: write 0.1, 1, 10 or max", param, ctx)
        if not speed > 0:
            self.fail(f"{value} is no speed: above 0", param, ctx)
        return speed


@click.command()
@click.argument("log_path", metavar="LOG", type=FILE)
@CONFIG
@click.option(
    "-o",
    "--output",
    "output_path",
    type=FILE,
    help="Candump log to write with the host's frames; - is standard output.",
)
@click.option("--speed", type=Speed(), default="max", show_default=True, help="0.1, 1, 10, ... or max.")
@click.option("--frames", is_flag=True, help="Show every frame, decoded.")
@click.option("--step", "stepwise", is_flag=True, help="Wait for a key after each frame and tick.")
def replay(
    log_path: Path, config_path: Path, output_path: Path | None, speed: float, frames: bool, stepwise: bool
) -> None:
    """Run the host again on a bus log and compare every frame it sends with the log.

    LOG is candump -L (also .gz), Vector ASC or BLF; it is only read. Changes of mode are shown as they come.
    A log with the host's records is replayed with its commands; the first difference ends the replay. A log
    without them is replayed without commands, and its frames are not compared.

    Exit status: 0 done, 2 another hand or calibration, 6 a damaged log, 10 a difference.

    \b
    Examples:
      palpate-host replay demo.log --config hand.toml -o answers.log
      palpate-host replay demo.log --config hand.toml --speed 1
      palpate-host replay trace.blf --config hand.toml --step
    """
    config, hand = host.load_hand(config_path)
    log = read_hand_log(log_path, config)
    for lack in log.lacks:
        click.echo(f"note: {log_path} lacks {lack}", err=True)
    begin_us = log.records[0].stamp_us
    taken = recorded_steps(log_path, log, config, hand) if log.ticks else steps(log.records, config, hand)
    if stepwise:
        taken = _by_key(taken, config, begin_us)
    else:
        taken = _shown(_paced(taken, speed), config, begin_us, frames)
    with notes_beside(output_path):
        result = replay_steps(taken, config)
    if output_path is not None:
        write_output(output_path, result)
    with notes_beside(output_path):
        _summarise(result)
        if log.ticks and not stepwise:
            click.echo(f"{len(log.ticks)} ticks: every frame of the host is as recorded")


def _summarise(result: Replay) -> None:
    modes = " ".join(mode.value for mode in result.modes)
    click.echo(f"{result.frames_in} frames in, {len(result.records)} frames out, modes: {modes}")
    if result.failure:
        click.echo(f"the hand stopped: {result.failure}")


def _paced(taken: Iterator[ReplayStep], speed: float) -> Iterator[ReplayStep]:
    """Each step at its time, `speed` times faster; never earlier."""
    begin_us, begin_s = None, time.monotonic()
    for step in taken:
        begin_us = step.now_us if begin_us is None else begin_us
        ahead_s = (step.now_us - begin_us) / 1e6 / speed - (time.monotonic() - begin_s)
        if ahead_s > 0:
            time.sleep(ahead_s)
        yield step


def _shown(
    taken: Iterator[ReplayStep], config: HandConfig, begin_us: int, frames: bool
) -> Iterator[ReplayStep]:
    """Prints changes of mode, and every frame when asked."""
    decoder, mode = Decoder(devices_of_hand(config)), None
    for step in taken:
        if frames:
            for record in (*step.taken, *step.answers):
                click.echo(line(decoder.decode(record), begin_us))
        status = step.output.status
        if status is not None and status.mode is not mode:
            mode = status.mode
            click.echo(_mode_line(step, begin_us))
        yield step


def _by_key(taken: Iterator[ReplayStep], config: HandConfig, begin_us: int) -> Iterator[ReplayStep]:
    """Shows one frame or one tick's reaction at a time and waits for a key after each."""
    decoder, mode, skip = Decoder(devices_of_hand(config)), None, ""
    click.echo(KEYS, err=True)
    for step in taken:
        for record in step.taken:
            click.echo("in   " + _line(decoder, record, begin_us))
            skip = skip or _key()
            if skip == "q":
                return
        for record in step.answers:
            click.echo("out  " + _line(decoder, record, begin_us))
        yield step
        status = step.output.status
        changed = status is not None and status.mode is not mode
        if status is not None:
            mode = status.mode
            click.echo(_mode_line(step, begin_us))
        if skip != "m" or changed:
            skip = _key()
        if skip == "q":
            return
        skip = skip if skip == "m" else ""


def _key() -> str:
    """t, m or q as it was pressed; empty for any other key."""
    pressed = click.getchar().lower()
    return "q" if pressed in ("q", "\x03", "\x04", "") else pressed if pressed in GO_ON else ""


def _line(decoder: Decoder, record: LogRecord, begin_us: int) -> str:
    return line(decoder.decode(record), begin_us)


def _mode_line(step: ReplayStep, begin_us: int) -> str:
    status = step.output.status
    assert status is not None
    warning = f"; {status.warning}" if status.warning else ""
    return f"{(step.now_us - begin_us) / 1e6:>12.6f}  {status.mode.value.upper()}: {status.reason}{warning}"
