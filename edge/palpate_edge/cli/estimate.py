"""``palpate-edge estimate``: contacts of recorded frames as CSV."""

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
@click.argument("frames", type=INPUT)
@calibration_option
@click.option(
    "--csv", "csv_path", type=OUTPUT, required=True, help="CSV file to write; - is standard output."
)
@method_option
def estimate(frames: Path, calibration_path: Path, csv_path: Path, method: str) -> None:
    """Estimate contact and force in FRAMES.

    FRAMES is a folder of images, a press dataset, one image or a video. Positions are in mm and forces in N
    in the fingertip frame F. Empty fields are unknown; a rejected frame has quality 0 and a reason. With 95 %
    probability a contact is within radius95_mm of its position. A calibration of pose labels fills their
    columns; those ending in _95 are half widths of 95 % intervals.

    \b
    Example:
      palpate-edge estimate demo/recording/press --calibration finger-1.cal --csv contacts.csv
    """
    from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_calibration_file import (  # noqa: PLC0415
        is_pose_calibration,
        load_pose_calibration,
    )
    from palpate_edge.diagnostics.batch import estimate_poses, estimate_recording  # noqa: PLC0415
    from palpate_edge.diagnostics.contact_csv import write_contacts  # noqa: PLC0415

    if is_pose_calibration(calibration_path):
        refuse_method(calibration_path, method)
        pose_calibration = load_pose_calibration(calibration_path)
        with progress_bar("estimating") as progress:
            write_contacts(csv_path, estimate_poses(frames, pose_calibration, calibration_path, progress))
    else:
        calibration = load_calibration(calibration_path)
        with progress_bar("estimating") as progress:
            rows = estimate_recording(frames, calibration, calibration_path, progress, method_of(method))
            write_contacts(csv_path, rows)
    report(f"{csv_path} written", csv_path)
