"""``palpate-edge press-rig``: press the dome with a 3-D printer, for a calibration."""

from __future__ import annotations

import time
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate_edge.cli.options import INPUT, OUTPUT, config_option

if TYPE_CHECKING:
    from palpate_edge.daemon.config import FingertipConfig
    from palpate_edge.press_rig.rig_config import RigConfig
    from palpate_edge.press_rig.run_files import RunFiles


@click.command("press-rig")
@config_option
@click.option("--rig", "rig_path", type=INPUT, required=True, help="Printer and scale: rig.toml.")
@click.option("-o", "--output", type=OUTPUT, required=True, help="Folder of the press dataset.")
@click.option(
    "--presses",
    type=click.IntRange(10, 5000),
    default=200,
    show_default=True,
    help="Number of presses for training.",
)
@click.option(
    "--test-presses",
    type=click.IntRange(0, 5000),
    default=20,
    show_default=True,
    help="Number of presses for testing.",
)
@click.option(
    "--press-seed", type=click.IntRange(0), default=0, show_default=True, help="Random seed of the presses."
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    help="Show the run in the browser, on this port of 127.0.0.1. 0: any free.",
)
@click.option("--yes", is_flag=True, help="Do not ask before the printer moves.")
@click.option("--labels-only", is_flag=True, help="Move nothing: label the presses taken so far.")
def press_rig(
    config_path: Path,
    rig_path: Path,
    output: Path,
    presses: int,
    test_presses: int,
    press_seed: int,
    port: int | None,
    yes: bool,
    labels_only: bool,
) -> None:
    """Press the dome with a 3-D printer and write a press dataset.

    A printer with Marlin or Klipper carries a ball, the fingertip stands on a scale below it. The dome is
    found by touch, then pressed and sheared all over; the camera takes a picture of each press. The printer
    stays inside the box of rig.toml, and lifts the ball off at a force over the limit, when the scale is
    silent, and on Ctrl-C. A run that was stopped is continued by the same command. Home the printer first.
    With --port a page in the browser has the picture, the progress and a button to stop.

    \b
    Examples:
      palpate-edge press-rig --config finger-1.toml --rig rig.toml -o finger-1-presses
      palpate-edge press-rig --config finger-1.toml --rig rig.toml -o finger-1-presses --port 8470

    Exit status: 0 complete, 2 configuration or a move that is not allowed, 5 camera, 8 stopped.
    """
    from palpate_edge.calibration.training.dome_model import load_dome_model  # noqa: PLC0415
    from palpate_edge.common.errors import MissingExtraError  # noqa: PLC0415
    from palpate_edge.common.progress import progress_bar  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.press_rig.rig_config import read_rig  # noqa: PLC0415

    rig, config = read_rig(rig_path), read_config(config_path)
    try:
        from palpate_edge.press_rig.labels import label_run  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise MissingExtraError("palpate-edge press-rig", str(error.name), "press-rig") from error
    files = _open_files(config, rig, output, (presses, test_presses, press_seed))
    if not labels_only:
        if not yes:
            click.confirm(
                f"The printer at {rig.printer.port} will move between {_corner(rig.box.low_mm)} and "
                f"{_corner(rig.box.high_mm)} mm. Is it homed, and the box free?",
                abort=True,
            )
        _run(config, rig, files, port)
    count = len(files.journal.records)
    with progress_bar("labelling") as progress:
        report = label_run(output, files.journal, load_dome_model(), lambda done: progress(done, count + 8))
    click.echo(
        f"{output}: {report.presses} presses; the fingertip leans {report.tilt_deg:.1f} deg and is turned by "
        f"{report.turn_deg:+.1f} deg; the dome model is {report.mounting_off_mm:.2f} mm off in place and "
        f"{report.model_error_percent:.1f} % in force"
    )
    if report.unseen:
        click.echo(
            f"  {report.unseen} presses move the skin too little to be seen: their force is less exact"
        )
    click.echo(f"  next: palpate-edge calibrate {output} -o {config.name}.cal")


def _corner(corner_mm: tuple[float, float, float]) -> str:
    return "({:g}, {:g}, {:g})".format(*corner_mm)


def _open_files(
    config: FingertipConfig, rig: RigConfig, output: Path, numbers: tuple[int, int, int]
) -> RunFiles:
    """Return the run's folder, new or to be continued. Raises ConfigError or DatasetError."""
    from palpate_edge.common.errors import ConfigError  # noqa: PLC0415
    from palpate_edge.datasets.sensor_file import read_sensor  # noqa: PLC0415
    from palpate_edge.press_rig.journal import new_journal  # noqa: PLC0415
    from palpate_edge.press_rig.run_files import RunFiles  # noqa: PLC0415

    described = Path(config.estimator.sensor) if config.estimator.sensor else output / "sensor.toml"
    if not described.is_file():
        raise ConfigError(f"{described}: no such file: set estimator.sensor to the fingertip's sensor.toml")
    fresh = new_journal(rig, read_sensor(described), *numbers)
    return RunFiles(output, described, fresh)


def _run(config: FingertipConfig, rig: RigConfig, files: RunFiles, port: int | None) -> None:
    """Take the frames that are missing. port: of the run's page; None: no page.

    Raises RigError, ConfigError or CaptureError.
    """
    from palpate_edge.can_bus.simulated_clock import clock_of  # noqa: PLC0415
    from palpate_edge.common.errors import CaptureError  # noqa: PLC0415
    from palpate_edge.common.progress import progress_bar  # noqa: PLC0415
    from palpate_edge.common.signals import stop_event  # noqa: PLC0415
    from palpate_edge.console.rig_page import serve_rig  # noqa: PLC0415
    from palpate_edge.daemon.capture_factory import open_source  # noqa: PLC0415
    from palpate_edge.daemon.health import read_health  # noqa: PLC0415
    from palpate_edge.datasets.sensor_file import read_sensor  # noqa: PLC0415
    from palpate_edge.press_rig.plan import make_plan  # noqa: PLC0415
    from palpate_edge.press_rig.rig_core import RigCore, RigOutputs  # noqa: PLC0415
    from palpate_edge.press_rig.rig_run import RunCamera, open_port, run_rig  # noqa: PLC0415
    from palpate_edge.press_rig.run_sequence import RunSequence  # noqa: PLC0415
    from palpate_edge.press_rig.watched_camera import WatchedCamera  # noqa: PLC0415

    running = read_health(config.name, config.health, time.monotonic())
    if running is not None:
        raise CaptureError(f"the daemon of {config.name} has the camera (pid {running.pid}): stop it first")
    plan = make_plan(files.journal.plan)
    sensor = read_sensor(files.folder / "sensor.toml")
    sequence = RunSequence(rig, sensor, plan, files.journal.done, files.missing_references)
    core = RigCore(rig, sequence.run())
    clock = clock_of(config.bus)

    def report(line: str) -> None:
        click.echo(line, err=True)

    with ExitStack() as stack:
        printer = stack.enter_context(open_port(rig.printer.port, rig.printer.baud, "printer"))
        scale = stack.enter_context(open_port(rig.scale.port, rig.scale.baud, "scale"))
        source = open_source(config, None, clock, report)
        stack.enter_context(closing(source))
        camera: RunCamera = source
        stopped = stack.enter_context(stop_event())
        page = None
        if port is not None:
            page = stack.enter_context(serve_rig(config, port, len(plan), stopped, report))
            camera = stack.enter_context(closing(WatchedCamera(source, page.show)))
        progress = stack.enter_context(progress_bar("pressing"))

        def after_step(outputs: RigOutputs) -> None:
            for kept in outputs.keep:
                files.keep(kept)
                progress(len(files.journal.records), len(plan))
            for line in outputs.lines:
                report(line)
            if page is not None:
                page.step(core, sequence.place, files.journal.records, outputs.lines)

        run_rig(core, printer, scale, camera, clock.now_us, stopped, after_step)
