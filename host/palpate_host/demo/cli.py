"""``palpate-host demo``."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from rich.console import Console
from rich.live import Live

from palpate_edge.dataset import read_dataset
from palpate_host.demo import orchestrator
from palpate_host.demo.analysis import analyse, summary_lines, write_summary
from palpate_host.demo.live_view import plain_line, render
from palpate_host.demo.monitor import Sight
from palpate_host.demo.orchestrator import DemoInterruptedError
from palpate_host.demo.run_folder import RunFolder, make_run_folder

CHECKOUT = Path(__file__).resolve().parents[3]
FOLDER = click.Path(path_type=Path, file_okay=False)
INTERRUPTED_EXIT_STATUS = 130  # as a shell says for SIGINT
PLAIN_PERIOD_S = 1.0


@click.command()
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=1),
    default=20.0,
    show_default=True,
    help="Seconds to run, once the hand operates.",
)
@click.option(
    "--recording",
    type=FOLDER,
    default=CHECKOUT / "demo" / "recording",
    show_default="demo/recording",
    help="Folder with press/ (to calibrate with) and one recording a finger.",
)
@click.option(
    "--output",
    type=FOLDER,
    default=CHECKOUT / "demo",
    show_default="demo",
    help="Takes run/ and report.html.",
)
@click.option("--no-view", is_flag=True, help="One line a second instead of the live view.")
@click.option(
    "--bitrate", type=click.IntRange(10_000, 1_000_000), default=1_000_000, show_default=True, help="bit/s."
)
@click.option("--report-only", is_flag=True, help="Make the report of the last run again, from its bus log.")
def demo(
    duration_s: float, recording: Path, output: Path, no_view: bool, bitrate: int, report_only: bool
) -> None:
    """A whole hand on this machine: three fingertips, nine simulated drives and the host, each a process.

    \b
    palpate-host demo
    palpate-host demo --duration 60 --no-view
    palpate-host demo --report-only
    """
    if report_only:
        folder = RunFolder((output / "run").resolve())
    else:
        folder = make_run_folder(output / "run", recording, bitrate)
        try:
            _run(folder, recording.resolve(), duration_s, plain=no_view or not sys.stdout.isatty())
        except DemoInterruptedError:
            click.echo("stopped; palpate-host demo --report-only makes the report of what was recorded")
            sys.exit(INTERRUPTED_EXIT_STATUS)
    _report(folder, output / "report.html")


def _run(folder: RunFolder, recording: Path, duration_s: float, *, plain: bool) -> None:
    hand = folder.hand()
    presses = [press for finger in hand.fingers for press in read_dataset(recording / finger.name).presses]
    largest_N = max((press.normal_force_N for press in presses), default=0.0)
    scale = orchestrator.view_scale(hand, recording, duration_s, largest_N or 1.0)
    if plain:
        orchestrator.run(folder, recording, duration_s, click.echo, _PlainView())
        return
    with Live(console=Console(), screen=True, auto_refresh=False) as live:
        orchestrator.run(
            folder,
            recording,
            duration_s,
            say=lambda line: live.update(line, refresh=True),
            show=lambda sight, elapsed_s: live.update(render(sight, scale, elapsed_s), refresh=True),
        )


class _PlainView:
    """One line a second of what it is shown."""

    def __init__(self) -> None:
        self._next_s = 0.0

    def __call__(self, sight: Sight, elapsed_s: float) -> None:
        if elapsed_s >= self._next_s:
            self._next_s += PLAIN_PERIOD_S
            click.echo(plain_line(sight, elapsed_s))


def _report(folder: RunFolder, path: Path) -> None:
    from palpate_host.demo.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    analysis = analyse(folder)
    write_summary(folder.summary, analysis.summary)
    write_report(path, analysis, folder)
    for line in (*summary_lines(analysis.summary), f"report:  {path}", f"figures: {folder.summary}"):
        click.echo(line)
    click.echo(f"bus log: {folder.log}")
