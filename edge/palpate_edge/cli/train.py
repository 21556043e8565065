"""``palpate-edge train``: a dome model, or a pose model, from the presses of several sensors."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import INPUT, OUTPUT
from palpate_edge.common.progress import progress_bar


@click.command()
@click.argument("datasets", type=INPUT, nargs=-1, required=True)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Model file to write (.npz).")
def train(datasets: tuple[Path, ...], output: Path) -> None:
    """Make a dome model from the presses of DATASETS.

    With `calibrate --dome-model` a sensor of the same make then needs few presses of its own. DATASETS with
    pose labels give a pose model, for sensors with the same markers (docs/own-sensor.md).

    \b
    Example:
      palpate-edge train demo/recording/press -o dome.npz
    """
    from palpate_edge.datasets.pose_dataset import is_pose_dataset  # noqa: PLC0415

    if any(is_pose_dataset(folder) for folder in datasets):
        _train_poses(datasets, output)
        return
    from palpate_edge.calibration.training.dome_model import save_dome_model  # noqa: PLC0415
    from palpate_edge.calibration.training.pretrain import pretrain  # noqa: PLC0415

    with progress_bar("training") as progress:
        dome = pretrain(datasets, progress)
    save_dome_model(dome, output)
    torsion = "" if dome.twisted is None else ", with torsion"
    click.echo(f"{output}: {len(dome.fields)} samples of {len(datasets)} sensors{torsion}")


def _train_poses(datasets: tuple[Path, ...], output: Path) -> None:
    from palpate_edge.calibration.pose.pose_model import save_pose_model  # noqa: PLC0415
    from palpate_edge.calibration.pose.pose_pretrain import pretrain_poses  # noqa: PLC0415

    with progress_bar("training") as progress:
        model = pretrain_poses(datasets, progress)
    save_pose_model(model, output)
    click.echo(
        f"{output}: {len(model.targets)} presses of {len(datasets)} sensors with {len(model.rest_px)} beads: "
        f"{', '.join(model.labels)}"
    )
