"""palpate-edge: calibrate a fingertip, estimate recorded frames, run the fingertip's daemon."""

from __future__ import annotations

import hashlib
import os
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click
import cv2

from palpate_edge import __version__
from palpate_edge.cli.inspect_commands import follow, inspect
from palpate_edge.cli.service_commands import check, identify, record
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.progress import progress_bar

if TYPE_CHECKING:
    from palpate_edge.estimation.calibration import Calibration
    from palpate_edge.estimation.estimator import Method

INPUT = click.Path(path_type=Path)
METHOD = click.option(
    "--method",
    type=click.Choice(["best", "paper", "corrected"]),
    default="best",
    show_default=True,
    help="best: corrected when the calibration holds a model, else paper.",
)


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="palpate-edge")
def cli() -> None:
    """Touch for robot hands: the programs of a fingertip's board.

    \b
    Examples:
      palpate-edge calibrate demo/recording/press -o finger-1.cal
      palpate-edge estimate demo/recording/press --calibration finger-1.cal --csv contacts.csv
      palpate-edge run --config finger-1.toml
      palpate-edge check --config finger-1.toml

    \b
    Exit status: 0 success, 1 unexpected error, 2 configuration, 3 dataset or image, 4 calibration,
    5 capture, 6 bus, 7 illumination controller.
    """
    cv2.setNumThreads(1)
    _quieten_libraries()


def _quieten_libraries() -> None:
    """Silence OpenCV and FFmpeg: errors are reported by this program's one line on stderr."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # AV_LOG_QUIET
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)


@cli.command()
@click.argument("dataset", type=INPUT)
@click.option("-o", "--output", type=INPUT, required=True, help="Calibration file to write.")
@click.option("--no-model", is_flag=True, help="Make no correction model: the paper's method only.")
@click.option(
    "--dome-model",
    type=INPUT,
    help="Start from this dome model (of palpate-edge train) instead of the packaged one.",
)
@click.option(
    "--picture", type=INPUT, help="Also draw the distance of each bead from the fitted layout (.png)."
)
def calibrate(
    dataset: Path, output: Path, no_model: bool, dome_model: Path | None, picture: Path | None
) -> None:
    """Make a calibration from a press DATASET.

    Layout and camera pose are fitted to the reference frames. The paper's correction function, the stiffness
    and the correction model are fitted to the train split of the presses; without presses the correction
    model is the dome model, and no force is estimated.

    \b
    Example:
      palpate-edge calibrate demo/recording/press -o finger-1.cal
    """
    from palpate_edge.calibration.calibrate import calibrate as make  # noqa: PLC0415 - the daemon never needs it
    from palpate_edge.calibration.calibration_file import save_calibration  # noqa: PLC0415
    from palpate_edge.calibration.training.dome_model import SHIPPED, load_dome_model  # noqa: PLC0415
    from palpate_edge.datasets.press_dataset import read_dataset  # noqa: PLC0415

    trainable = all(find_spec(name) for name in ("onnx", "onnxruntime"))
    with progress_bar("calibrating") as progress:
        dome = load_dome_model(dome_model or SHIPPED) if trainable and not no_model else None
        calibration = make(read_dataset(dataset), progress, dome=dome)
    save_calibration(calibration, output)
    if picture is not None:
        _draw_residuals(dataset, calibration, picture)
    pose = calibration.pose
    click.echo(
        f"{output}: sensor {calibration.sensor.fingerprint()}, {len(calibration.beads)} beads "
        f"({'bright' if calibration.appearance.bright else 'dark'} on {calibration.appearance.channel}), "
        f"{calibration.source.reference_frames} reference frames, {calibration.source.presses} presses"
    )
    click.echo(
        "  camera off by "
        + ", ".join(f"{value:+.2f}" for value in pose.offset_mm)
        + f" mm, focal length x {pose.focal_scale:.4f}; layout residual "
        f"{calibration.residual_px:.2f} px rms; "
        f"contact above {calibration.contact_threshold_px:.3f} px of skin motion"
        + (
            ""
            if calibration.contact_threshold_N is None
            else f", {calibration.contact_threshold_N:.3f} N where the dome is stiffest"
        )
    )
    if calibration.model:
        click.echo(
            f"  correction model of {len(calibration.model) / 1e6:.1f} MB, sha256 {digest(calibration)}"
        )
    elif not trainable and not no_model:
        click.echo("  no correction model: it needs pip install 'palpate[train]'")
    if not calibration.paper.stiffness_N_px:
        click.echo("  no press of known force: no force is estimated")


def _draw_residuals(dataset: Path, calibration: Calibration, picture: Path) -> None:
    from palpate_edge.datasets.images import read_image  # noqa: PLC0415
    from palpate_edge.datasets.press_dataset import read_dataset  # noqa: PLC0415
    from palpate_edge.diagnostics.canvas import write_picture  # noqa: PLC0415
    from palpate_edge.diagnostics.figures import draw_residuals  # noqa: PLC0415

    write_picture(picture, draw_residuals(read_image(read_dataset(dataset).reference[0]), calibration))


@cli.command()
@click.argument("datasets", type=INPUT, nargs=-1, required=True)
@click.option("-o", "--output", type=INPUT, required=True, help="Dome model file to write (.npz).")
def train(datasets: tuple[Path, ...], output: Path) -> None:
    """Make a dome model from the presses of DATASETS.

    With `calibrate --dome-model` a sensor of the same make then needs few presses of its own.

    \b
    Example:
      palpate-edge train demo/recording/press -o dome.npz
    """
    from palpate_edge.calibration.training.dome_model import save_dome_model  # noqa: PLC0415
    from palpate_edge.calibration.training.pretrain import pretrain  # noqa: PLC0415

    with progress_bar("training") as progress:
        dome = pretrain(datasets, progress)
    save_dome_model(dome, output)
    click.echo(f"{output}: {len(dome.fields)} samples of {len(datasets)} sensors")


@cli.command()
@click.argument("frames", type=INPUT)
@click.option("--calibration", "calibration_path", type=INPUT, required=True, help="Calibration file.")
@click.option("--csv", "csv_path", type=INPUT, required=True, help="CSV file to write.")
@METHOD
def estimate(frames: Path, calibration_path: Path, csv_path: Path, method: str) -> None:
    """Estimate contact and force in FRAMES.

    FRAMES is a folder of images, a press dataset, one image or a video. Positions are in mm and forces in N
    in the fingertip frame F. Empty fields are unknown; a rejected frame has quality 0 and a reason. With 95 %
    probability a contact is within radius95_mm of its position.

    \b
    Example:
      palpate-edge estimate demo/recording/press --calibration finger-1.cal --csv contacts.csv
    """
    from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
    from palpate_edge.diagnostics.batch import estimate_recording  # noqa: PLC0415
    from palpate_edge.diagnostics.contact_csv import write_contacts  # noqa: PLC0415

    calibration = load_calibration(calibration_path)
    with progress_bar("estimating") as progress:
        rows = estimate_recording(frames, calibration, calibration_path, progress, method_of(method))
        write_contacts(csv_path, rows)
    click.echo(f"{csv_path} written")


@cli.command()
@click.argument("dataset", type=INPUT)
@click.option("--calibration", "calibration_path", type=INPUT, required=True, help="Calibration file.")
@click.option("--split", default="test", show_default=True, help="Rows of truth.csv to evaluate.")
@click.option("--json", "json_path", type=INPUT, help="Also write the figures to this JSON file.")
@METHOD
def evaluate(dataset: Path, calibration_path: Path, split: str, json_path: Path | None, method: str) -> None:
    """Measure position, force and contact errors on a DATASET.

    The DATASET has to contain presses with truth. Errors are printed by the regions of the paper's Fig. 8b (1
    = 15-30 deg above the base plane, 5 = 75-90), by thirds of the largest force, and over all presses.

    \b
    Example:
      palpate-edge evaluate demo/recording/press --calibration finger-1.cal
    """
    from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
    from palpate_edge.calibration.evaluation import evaluate_dataset, write_json  # noqa: PLC0415
    from palpate_edge.calibration.evaluation_report import as_table  # noqa: PLC0415

    calibration = load_calibration(calibration_path)
    with progress_bar("evaluating") as progress:
        figures = evaluate_dataset(dataset, split, calibration, calibration_path, method_of(method), progress)
    click.echo(as_table(figures))
    if json_path is not None:
        write_json(figures, json_path)


@cli.command()
@click.option("--config", "config_path", type=INPUT, required=True, help="The fingertip's TOML file.")
def run(config_path: Path) -> None:
    """Run the fingertip's daemon until SIGTERM or Ctrl-C.

    The daemon reads frames, estimates contacts and publishes them on the bus. It logs to standard error, with
    priorities when systemd collects it. A lost camera or bus is reopened; other errors end the daemon with
    the exit statuses of `palpate-edge --help`.

    \b
    Example:
      palpate-edge run --config finger-1.toml
    """
    from palpate_edge.common.logs import logging_to_stderr  # noqa: PLC0415
    from palpate_edge.daemon.config import read_config  # noqa: PLC0415
    from palpate_edge.daemon.daemon import run as serve  # noqa: PLC0415

    config = read_config(config_path)
    with logging_to_stderr(config.name):
        serve(config)


cli.add_command(inspect)
cli.add_command(follow)
cli.add_command(check)
cli.add_command(record)
cli.add_command(identify)


def method_of(name: str) -> Method | None:
    """Return the method of the --method option; None for the calibration's best."""
    from palpate_edge.estimation.estimator import Method  # noqa: PLC0415

    return None if name == "best" else Method(name)


def digest(calibration: Calibration) -> str:
    """Return the first digits of the model's SHA-256."""
    return hashlib.sha256(calibration.model).hexdigest()[:16]


def main() -> None:
    """Run the command line; an error becomes one line on stderr and an exit status that is not 0."""
    run_cli(cli)


if __name__ == "__main__":
    main()
