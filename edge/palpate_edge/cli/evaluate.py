"""``palpate-edge evaluate``: errors of the estimator on a press dataset with truth."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import (
    INPUT,
    OUTPUT,
    calibration_option,
    method_of,
    method_option,
    refuse_method,
    report,
)
from palpate_edge.common.progress import progress_bar


@click.command()
@click.argument("dataset", type=INPUT)
@calibration_option
@click.option("--split", default="test", show_default=True, help="Rows of truth.csv to evaluate.")
@click.option(
    "--json",
    "json_path",
    type=OUTPUT,
    help="Also write the figures to this JSON file; - is standard output, the table then goes to standard "
    "error.",
)
@method_option
def evaluate(dataset: Path, calibration_path: Path, split: str, json_path: Path | None, method: str) -> None:
    """Measure position, force and contact errors on a DATASET.

    The DATASET has to contain presses with truth. Errors are printed by the regions of the paper's Fig. 8b (1
    = 15-30 deg above the base plane, 5 = 75-90), by thirds of the largest force, and over all presses; of
    presses on a scale the error of the normal force. With a
    calibration of pose labels the errors of each label are printed, and how many are within its interval.

    \b
    Examples:
      palpate-edge evaluate dome-7 --calibration dome-7.cal
      palpate-edge evaluate demo/recording/press --calibration finger-1.cal --split train
    """
    from palpate_edge.calibration.pose.pose_calibration_file import is_pose_calibration  # noqa: PLC0415

    if is_pose_calibration(calibration_path):
        _evaluate_pose(dataset, calibration_path, split, json_path, method)
        return
    from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
    from palpate_edge.calibration.evaluation import evaluate_dataset, write_json  # noqa: PLC0415
    from palpate_edge.calibration.evaluation_report import as_table  # noqa: PLC0415

    calibration = load_calibration(calibration_path)
    with progress_bar("evaluating") as progress:
        figures = evaluate_dataset(dataset, split, calibration, calibration_path, method_of(method), progress)
    report(as_table(figures), json_path)
    if json_path is not None:
        write_json(figures, json_path)


def _evaluate_pose(
    dataset: Path, calibration_path: Path, split: str, json_path: Path | None, method: str
) -> None:
    from palpate_edge.calibration.evaluation import write_json  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_calibration_file import load_pose_calibration  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_evaluation import evaluate_pose, pose_table  # noqa: PLC0415

    refuse_method(calibration_path, method)
    calibration = load_pose_calibration(calibration_path)
    with progress_bar("evaluating") as progress:
        figures = evaluate_pose(dataset, split, calibration, calibration_path, progress)
    report(pose_table(figures), json_path)
    if json_path is not None:
        write_json(figures, json_path)
