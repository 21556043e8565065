"""``palpate-edge train``: a dome model from the presses of several sensors."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import INPUT, OUTPUT
from palpate_edge.common.progress import progress_bar


@click.command()
@click.argument("datasets", type=INPUT, nargs=-1, required=True)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Dome model file to write (.npz).")
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
