"""``palpate-edge calibrate``: a calibration file from a press dataset."""

from __future__ import annotations

import hashlib
import math
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate_edge.cli.options import INPUT, OUTPUT
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.common.progress import progress_bar

if TYPE_CHECKING:
    from palpate_edge.estimation.calibration import Calibration, CalibrationSource


WEIGHED_ACCURACY = "an error of 2 to 4 % of the largest force (root mean square, simulated sensors)"


@click.command()
@click.argument("dataset", type=INPUT)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Calibration file to write.")
@click.option("--no-model", is_flag=True, help="Make no correction model: the paper's method only.")
@click.option(
    "--dome-model",
    type=INPUT,
    help="Start from this dome model, or pose model, of palpate-edge train instead of the packaged one.",
)
@click.option(
    "--picture", type=OUTPUT, help="Also draw the distance of each bead from the fitted layout (.png)."
)
@click.option(
    "--report", "report_path", type=OUTPUT, help="Also draw the errors by region and the verdict (.svg)."
)
@click.option(
    "--labels",
    type=click.Choice(["contact", "pose"]),
    help="Labels to learn from a DATASET that has contact places and poses. [default: contact]",
)
def calibrate(
    dataset: Path,
    output: Path,
    no_model: bool,
    dome_model: Path | None,
    picture: Path | None,
    report_path: Path | None,
    labels: str | None,
) -> None:
    """Make a calibration from a press DATASET.

    Layout and camera pose are fitted to the reference frames. The paper's correction function, the stiffness
    and the correction model are fitted to the train split of the presses; without presses the correction
    model is the dome model, and no force is estimated. Presses of the apex on a kitchen scale (weights.csv)
    give it the force; those through a printed jig (docs/jig.md) adjust the positions too. A DATASET whose
    truth.csv has pose labels in place of contact places needs no drawing of the sensor (docs/own-sensor.md).
    Where it has both, --labels chooses; a calibration gives contacts or poses.

    \b
    Example:
      palpate-edge calibrate demo/recording/press -o finger-1.cal
    """
    from palpate_edge.datasets.pose_dataset import has_both_labels, is_pose_dataset  # noqa: PLC0415

    if labels == "contact" and is_pose_dataset(dataset):
        raise DatasetError(f"{dataset / 'truth.csv'} has no contact places: leave out --labels contact")
    if labels == "pose" or is_pose_dataset(dataset):
        has_dome_option = no_model or picture is not None or report_path is not None
        _calibrate_pose(dataset, output, dome_model, has_dome_option)
        return
    from palpate_edge.calibration.calibrate import calibrate as make  # noqa: PLC0415 - the daemon never needs it
    from palpate_edge.calibration.calibration_file import save_calibration  # noqa: PLC0415
    from palpate_edge.calibration.mounting import UPRIGHT_RAD  # noqa: PLC0415
    from palpate_edge.calibration.training.dome_model import SHIPPED, load_dome_model  # noqa: PLC0415
    from palpate_edge.common.atomic_write import write_atomically  # noqa: PLC0415
    from palpate_edge.datasets.press_dataset import read_dataset  # noqa: PLC0415
    from palpate_edge.guide.calibration_report import region_figures, report_judgement  # noqa: PLC0415
    from palpate_edge.guide.report_picture import report_svg  # noqa: PLC0415

    trainable = all(find_spec(name) for name in ("onnx", "onnxruntime"))
    with progress_bar("calibrating") as progress:
        dome = load_dome_model(dome_model or SHIPPED) if trainable and not no_model else None
        calibration = make(read_dataset(dataset), progress, dome=dome)
    save_calibration(calibration, output)
    if picture is not None:
        _draw_residuals(dataset, calibration, picture)
    pose, source = calibration.pose, calibration.source
    click.echo(
        f"{output}: sensor {calibration.sensor.fingerprint()}, {len(calibration.beads)} beads "
        f"({'bright' if calibration.appearance.bright else 'dark'} on {calibration.appearance.channel}), "
        f"{source.reference_frames} reference frames, {source.presses} presses"
        + (f", {source.weighed} weighed" if source.weighed else "")
    )
    _print_dropped(source)
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
    turn_deg = math.degrees(pose.rotation_rad[2])
    if abs(turn_deg) > math.degrees(UPRIGHT_RAD):
        click.echo(f"  camera turned by {turn_deg:+.0f} deg about its axis, as the presses have it")
    if not source.presses:
        click.echo(
            "  no presses: contact positions are not tested on this sensor, nor how the camera is turned; "
            "press it at known places (docs/press-dataset.md) and run palpate-edge evaluate"
        )
    if calibration.model:
        click.echo(
            f"  correction model of {len(calibration.model) / 1e6:.1f} MB, sha256 {digest(calibration)}"
        )
    elif not trainable and not no_model:
        click.echo("  no correction model: it needs pip install 'palpate[train]'")
    if isinstance(calibration.fitted_beads, tuple):
        click.echo(
            f"  {len(calibration.fitted_beads)} beads are beside an edge or a reflection: "
            "their places are measured by symmetry"
        )
    _print_force(calibration)
    judgement = report_judgement(calibration)
    for name, text in region_figures(source.regions):
        click.echo(f"  {name}: {text}")
    click.echo(f"  {judgement.verdict.value}: {judgement.text}")
    if report_path is not None:
        write_atomically(report_path, report_svg(calibration).encode(), CalibrationError)
    if has_both_labels(dataset):
        click.echo("  the pose labels of truth.csv are not in it: learn them with --labels pose")


def _calibrate_pose(dataset: Path, output: Path, model: Path | None, has_dome_option: bool) -> None:
    from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_calibration_file import save_pose_calibration  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_model import load_pose_model  # noqa: PLC0415
    from palpate_edge.calibration.pose.transfer import calibrate_with_model  # noqa: PLC0415
    from palpate_edge.datasets.pose_dataset import read_pose_dataset  # noqa: PLC0415

    if has_dome_option:
        raise DatasetError(
            f"{dataset} has pose labels: leave out --no-model, --picture and --report, which need places"
        )
    with progress_bar("calibrating") as progress:
        if model is None:
            calibration = calibrate_pose(read_pose_dataset(dataset), progress)
        else:
            start = load_pose_model(model)
            calibration = calibrate_with_model(read_pose_dataset(dataset), start, progress)
    save_pose_calibration(calibration, output)
    source, looks = calibration.source, calibration.appearance
    click.echo(
        f"{output}: sensor {calibration.sensor.fingerprint()}, {len(calibration.beads)} beads "
        f"({'bright' if looks.bright else 'dark'} on {looks.channel}, {calibration.diameter_px:.1f} px), "
        f"{source.reference_frames} reference frames, {source.presses} presses"
    )
    _print_dropped(source)
    click.echo(
        f"  estimates {', '.join(calibration.labels)}; "
        f"contact above {calibration.contact_threshold_px:.2f} px of skin motion"
    )


def _print_force(calibration: Calibration) -> None:
    """Print where the force comes from and how exact it is, or that there is none."""
    from palpate_edge.estimation.contact_fit.place_stiffness import (  # noqa: PLC0415 - keeps --help fast
        PlaceStiffness,
        StiffnessMap,
    )

    spread_percent = calibration.source.weighed_spread_percent
    if spread_percent is not None:
        click.echo(
            f"  stiffness x {calibration.stiffness_scale:.3f} of the dome model's, from the weighed presses; "
            f"it misses them by {spread_percent:.1f} % of the largest; expect {WEIGHED_ACCURACY}"
        )
    elif calibration.stiffness_scale is None and not calibration.paper.stiffness_N_px:
        click.echo("  no press of known force: no force is estimated")
    if isinstance(calibration.place_stiffness, PlaceStiffness):
        low, high = StiffnessMap(calibration.place_stiffness).extremes()
        click.echo(f"  stiffness by place: forces x {low:.2f} to {high:.2f} of the correction model's")


def _print_dropped(source: CalibrationSource) -> None:
    """Print how many presses were left out, why, and which."""
    for dropped in source.dropped:
        names = ", ".join(dropped.frames) + (", ..." if dropped.count > len(dropped.frames) else "")
        click.echo(f"  left out {dropped.count} train frames: {dropped.reason}: {names}")


def _draw_residuals(dataset: Path, calibration: Calibration, picture: Path) -> None:
    from palpate_edge.common.picture_file import write_picture  # noqa: PLC0415
    from palpate_edge.datasets.images import read_image  # noqa: PLC0415
    from palpate_edge.datasets.press_dataset import read_dataset  # noqa: PLC0415
    from palpate_edge.diagnostics.figures import draw_residuals  # noqa: PLC0415

    write_picture(
        picture, draw_residuals(read_image(read_dataset(dataset).reference[0]), calibration), DatasetError
    )


def digest(calibration: Calibration) -> str:
    """Return the first digits of the model's SHA-256."""
    return hashlib.sha256(calibration.model).hexdigest()[:16]
