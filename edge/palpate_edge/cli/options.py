"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate_edge.common.atomic_write import STANDARD_OUTPUT
from palpate_edge.common.errors import CalibrationError

if TYPE_CHECKING:
    from palpate_edge.estimation.frame_estimator import Method

INPUT = click.Path(path_type=Path)
OUTPUT = click.Path(path_type=Path)

config_option = click.option(
    "--config", "config_path", type=INPUT, required=True, help="The fingertip's TOML file."
)
calibration_option = click.option(
    "--calibration", "calibration_path", type=INPUT, required=True, help="Calibration file."
)
method_option = click.option(
    "--method",
    type=click.Choice(["best", "paper", "corrected"]),
    default="best",
    show_default=True,
    help="best: corrected when the calibration holds a model, else paper.",
)
diameter_option = click.option(
    "--diameter", type=click.FloatRange(4, 200), help="Bead diameter in pixels, if known."
)


def method_of(name: str) -> Method | None:
    """Return the method of the --method option; None for the calibration's best."""
    from palpate_edge.estimation.frame_estimator import Method  # noqa: PLC0415 - slow to import

    return None if name == "best" else Method(name)


def refuse_method(calibration_path: Path, name: str) -> None:
    """Raise CalibrationError for a --method with a calibration of pose labels, which has one method only."""
    if name != "best":
        raise CalibrationError(
            f"{calibration_path} calibrates pose labels, which have no method {name}: leave out --method"
        )


def report(text: str, output: Path | None = None) -> None:
    """Print a result: to standard error when `output`, the file just written, is standard output."""
    click.echo(text, err=output == STANDARD_OUTPUT)
