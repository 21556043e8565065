"""Command ``palpate-host demo``."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from io import StringIO
from pathlib import Path

import click
from rich.console import Console
from rich.live import Live

from palpate_edge.common.atomic_write import disk_refusal_as, write_atomically
from palpate_edge.common.errors import ConfigError, MissingExtraError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_host.common.mode import Mode
from palpate_twin.demo import orchestrator
from palpate_twin.demo.analysis import analyse, summary_lines, write_summary
from palpate_twin.demo.film import make_film
from palpate_twin.demo.live_view import ViewScale, plain_line, render
from palpate_twin.demo.lockstep import run as run_in_lockstep
from palpate_twin.demo.monitor import MonitorSample
from palpate_twin.demo.orchestrator import DemoInterruptedError, ShowSample
from palpate_twin.demo.run_folder import RunFolder, locked_output, make_run_folder

FORCE_SCALE_N = 5.0  # full scale of the force bars in the live view
FOLDER = click.Path(path_type=Path, file_okay=False)
NEEDED = ("onnx", "onnxruntime", "scipy")  # by its other processes, long after the start
INTERRUPTED_EXIT_STATUS = 130  # the shell's status for SIGINT
PLAIN_PERIOD_S = 1.0
WEB_FONT = re.compile(r"@font-face \{.*?\}", re.DOTALL)  # removed so that the picture needs no network


@click.command()
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=1),
    default=21.0,
    show_default=True,
    help="Seconds to run, counted from the moment the hand operates.",
)
@click.option(
    "--recording",
    type=FOLDER,
    help="Play recorded frames instead of the simulated cameras: a folder with press/ (for the calibration) "
    "and one recording per finger.",
)
@click.option(
    "--output",
    type=FOLDER,
    default=Path("demo"),
    show_default=True,
    help="Folder for run/, sensors/ and report.html.",
)
@click.option("--no-view", is_flag=True, help="Print one line per second instead of the live view.")
@click.option(
    "--bitrate",
    type=click.IntRange(10_000, 1_000_000),
    default=1_000_000,
    show_default=True,
    help="Bit rate of the bus in bit/s.",
)
@click.option(
    "--lockstep",
    is_flag=True,
    help="Run in one process on simulated time: the same bytes on every run, on any machine.",
)
@click.option(
    "--seed",
    type=click.IntRange(0),
    default=1,
    show_default=True,
    help="Random seed of sensors and noise; only with --lockstep.",
)
@click.option(
    "--report-only", is_flag=True, help="Make the report of the last run again from its bus log; run nothing."
)
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
    """Run a simulated hand with the real programs: it grasps, turns and holds an object.

    The twin simulates hand, object and nine drives and renders the images of three fingertip cameras. Three
    fingertips, the bus and the host run as separate processes in real time. On a slow machine the simulation
    slows down; no deadline is missed.

    The command writes OUTPUT/report.html and OUTPUT/run/summary.json. Exit status: 0 done, 1 a process
    failed, 130 interrupted by Ctrl-C.

    \b
    Examples:
      palpate-host demo
      palpate-host demo --duration 60 --no-view
      palpate-host demo --lockstep
      palpate-host demo --recording demo/recording
      palpate-host demo --report-only
    """
    for library in NEEDED:
        if find_spec(library) is None:
            raise MissingExtraError("palpate-host demo", library, "demo")
    if lockstep and recording is not None:
        raise click.UsageError("--lockstep and --recording exclude each other: give one of them")
    with locked_output(output), disk_refusal_as(output, ConfigError):
        if report_only:
            _report(RunFolder((output / "run").resolve()), output / "report.html")
            return
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
            click.echo("interrupted; for a report of the recorded part: palpate-host demo --report-only")
            sys.exit(INTERRUPTED_EXIT_STATUS)
        _report(folder, output / "report.html")


def _run(
    folder: RunFolder, recording: Path | None, duration_s: float, seed: int | None, *, plain: bool
) -> None:
    """Run the demo with its view. seed: runs in lock step; None: runs in real time."""
    hand = folder.hand()
    largest_N = FORCE_SCALE_N
    if recording is not None:
        presses = [
            press for finger in hand.fingers for press in read_dataset(recording / finger.name).presses
        ]
        largest_N = max((press.normal_force_N or 0.0 for press in presses), default=largest_N)

    def run(report_progress: Callable[[str], None], show: ShowSample) -> None:
        if seed is None:
            orchestrator.run(folder, recording, duration_s, report_progress, show)
        else:
            run_in_lockstep(folder, duration_s, seed, report_progress, show)

    scale = orchestrator.view_scale(hand, duration_s, largest_N)
    snapshot = _Snapshot(scale)
    if plain:
        print_line = _PlainView()

        def show_line(sample: MonitorSample, elapsed_s: float) -> None:
            snapshot.update(sample, elapsed_s)
            print_line(sample, elapsed_s)

        run(click.echo, show_line)
    else:
        with Live(console=Console(), screen=True, auto_refresh=False) as live:

            def show(sample: MonitorSample, elapsed_s: float) -> None:
                snapshot.update(sample, elapsed_s)
                live.update(render(sample, scale, elapsed_s), refresh=True)

            run(lambda line: live.update(line, refresh=True), show)
    snapshot.save(folder.picture)


class _Snapshot:
    """SVG picture of the live view at the last sample in mode MANIPULATE."""

    def __init__(self, scale: ViewScale) -> None:
        self._scale = scale
        self._last: tuple[MonitorSample, float] | None = None

    def update(self, sample: MonitorSample, elapsed_s: float) -> None:
        if sample.status is not None and sample.status.mode is Mode.MANIPULATE:
            self._last = (sample, elapsed_s)

    def save(self, path: Path) -> None:
        if self._last is None:
            return
        console = Console(record=True, width=112, height=34, file=StringIO(), force_terminal=True)
        console.print(render(self._last[0], self._scale, self._last[1]))
        svg = console.export_svg(title="palpate-host demo")
        write_atomically(path, WEB_FONT.sub("", svg).encode(), ConfigError)


class _PlainView:
    """Prints the state as one line per second."""

    def __init__(self) -> None:
        self._next_s = 0.0

    def __call__(self, sample: MonitorSample, elapsed_s: float) -> None:
        if elapsed_s >= self._next_s:
            self._next_s += PLAIN_PERIOD_S
            click.echo(plain_line(sample, elapsed_s))


def _report(folder: RunFolder, path: Path) -> None:
    from palpate_twin.demo.report import write_report  # noqa: PLC0415 - matplotlib takes a second

    analysis = analyse(folder)
    write_summary(folder.summary, analysis.summary)
    with ThreadPoolExecutor(1) as beside:
        film = beside.submit(make_film, folder) if analysis.recording is None else None
        write_report(path, analysis, folder, film.result if film else None)
    if film is not None and not film.result().is_there:
        click.echo(f"no film: {film.result().description}")
    for line in (*summary_lines(analysis.summary), f"report:  {path}", f"figures: {folder.summary}"):
        click.echo(line)
    click.echo(f"bus log: {folder.log}")
