"""``palpate-host demo``."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path

import click
from rich.console import Console
from rich.live import Live

from palpate_edge.datasets.press_dataset import read_dataset
from palpate_host.common.mode import Mode
from palpate_twin.demo import orchestrator
from palpate_twin.demo.analysis import analyse, summary_lines, write_summary
from palpate_twin.demo.film import make_film
from palpate_twin.demo.live_view import Scale, plain_line, render
from palpate_twin.demo.lockstep import run as run_in_lockstep
from palpate_twin.demo.monitor import MonitorSample
from palpate_twin.demo.orchestrator import DemoInterruptedError, Show
from palpate_twin.demo.run_folder import RunFolder, make_run_folder

FORCE_SCALE_N = 5.0  # of the bars in the live view
CHECKOUT = Path(__file__).resolve().parents[3]
FOLDER = click.Path(path_type=Path, file_okay=False)
INTERRUPTED_EXIT_STATUS = 130  # as a shell says for SIGINT
PLAIN_PERIOD_S = 1.0
WEB_FONT = re.compile(r"@font-face \{.*?\}", re.DOTALL)  # the picture is to need no network


@click.command()
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=1),
    default=21.0,
    show_default=True,
    help="Seconds to run, once the hand operates.",
)
@click.option(
    "--recording",
    type=FOLDER,
    help="Play this in place of the twin: a folder with press/ (to calibrate with) and a recording a finger.",
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
@click.option(
    "--lockstep", is_flag=True, help="In one process on a virtual clock: for any machine, the same each time."
)
@click.option(
    "--seed", type=click.IntRange(0), default=1, show_default=True, help="Of sensors and noise, in lock step."
)
@click.option("--report-only", is_flag=True, help="Make the report of the last run again, from its bus log.")
def demo(
    duration_s: float,
    recording: Path | None,
    output: Path,
    no_view: bool,
    bitrate: int,
    lockstep: bool,
    seed: int,
    report_only: bool,
) -> None:
    """A whole hand on this machine, in real time: it grasps an object and turns it by what it feels.

    The twin moves hand, object and nine drives and renders what three fingertips see; the fingertips, the
    bus and the host are the real programs, each a process. On a machine that is too slow the hand waits, and
    says so.

    \b
    palpate-host demo
    palpate-host demo --duration 60 --no-view
    palpate-host demo --lockstep
    palpate-host demo --recording demo/recording
    palpate-host demo --report-only
    """
    if lockstep and recording is not None:
        raise click.UsageError("--lockstep has the twin's contacts: leave --recording out")
    if report_only:
        folder = RunFolder((output / "run").resolve())
    else:
        folder = make_run_folder(output / "run", recording, bitrate)
        try:
            _run(
                folder,
                recording and recording.resolve(),
                duration_s,
                seed if lockstep else None,
                plain=no_view or not sys.stdout.isatty(),
            )
        except DemoInterruptedError:
            click.echo("stopped; palpate-host demo --report-only makes the report of what was recorded")
            sys.exit(INTERRUPTED_EXIT_STATUS)
    _report(folder, output / "report.html")


def _run(
    folder: RunFolder, recording: Path | None, duration_s: float, seed: int | None, *, plain: bool
) -> None:
    """seed: in lock step; None: in real time."""
    hand = folder.hand()
    largest_N = FORCE_SCALE_N
    if recording is not None:
        presses = [
            press for finger in hand.fingers for press in read_dataset(recording / finger.name).presses
        ]
        largest_N = max((press.normal_force_N for press in presses), default=largest_N)

    def run(say: Callable[[str], None], show: Show) -> None:
        if seed is None:
            orchestrator.run(folder, recording, duration_s, say, show)
        else:
            run_in_lockstep(folder, duration_s, seed, say, show)

    scale = orchestrator.view_scale(hand, duration_s, largest_N)
    picture = _Picture(scale)
    if plain:
        lines = _PlainView()

        def show_line(sight: MonitorSample, elapsed_s: float) -> None:
            picture.see(sight, elapsed_s)
            lines(sight, elapsed_s)

        run(click.echo, show_line)
    else:
        with Live(console=Console(), screen=True, auto_refresh=False) as live:

            def show(sight: MonitorSample, elapsed_s: float) -> None:
                picture.see(sight, elapsed_s)
                live.update(render(sight, scale, elapsed_s), refresh=True)

            run(lambda line: live.update(line, refresh=True), show)
    picture.save(folder.picture)


class _Picture:
    """The live view as it was when the hand last manipulated, as an SVG."""

    def __init__(self, scale: Scale) -> None:
        self._scale = scale
        self._last: tuple[MonitorSample, float] | None = None

    def see(self, sight: MonitorSample, elapsed_s: float) -> None:
        if sight.status is not None and sight.status.mode is Mode.MANIPULATE:
            self._last = (sight, elapsed_s)

    def save(self, path: Path) -> None:
        if self._last is None:
            return
        console = Console(record=True, width=112, height=34, file=StringIO(), force_terminal=True)
        console.print(render(self._last[0], self._scale, self._last[1]))
        svg = console.export_svg(title="palpate-host demo")
        path.write_text(WEB_FONT.sub("", svg), encoding="utf-8")


class _PlainView:
    """One line a second of what it is shown."""

    def __init__(self) -> None:
        self._next_s = 0.0

    def __call__(self, sight: MonitorSample, elapsed_s: float) -> None:
        if elapsed_s >= self._next_s:
            self._next_s += PLAIN_PERIOD_S
            click.echo(plain_line(sight, elapsed_s))


def _report(folder: RunFolder, path: Path) -> None:
    from palpate_twin.demo.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    analysis = analyse(folder)
    write_summary(folder.summary, analysis.summary)
    film = make_film(folder) if analysis.recording is None else None
    write_report(path, analysis, folder, film)
    if film is not None and not film.is_there:
        click.echo(f"no film: {film.told}")
    for line in (*summary_lines(analysis.summary), f"report:  {path}", f"figures: {folder.summary}"):
        click.echo(line)
    click.echo(f"bus log: {folder.log}")
