"""``palpate-edge inspect``: a picture of the beads, or of every step of the estimator, in one frame."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import INPUT, OUTPUT, diameter_option
from palpate_edge.common.errors import DatasetError


@click.command()
@click.argument("frame", type=INPUT)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Picture to write (.png).")
@click.option(
    "--calibration",
    "calibration_path",
    type=INPUT,
    help="Draw every step from the frame to its contact.",
)
@diameter_option
def inspect(frame: Path, output: Path, calibration_path: Path | None, diameter: float | None) -> None:
    """Find and draw the beads of one image FRAME.

    No description of the sensor is needed. With --calibration, every step of the paper's and of the corrected
    method is drawn.

    \b
    Examples:
      palpate-edge inspect demo/recording/press/reference/000.jpg -o beads.png
      palpate-edge inspect frame.png -o steps.png --calibration finger-1.cal

    Exit status: 0 beads found, 3 no beads.
    """
    from palpate_edge.common.picture_file import write_picture  # noqa: PLC0415
    from palpate_edge.datasets.images import read_image  # noqa: PLC0415

    if calibration_path is not None and diameter is not None:
        raise click.UsageError("--diameter and --calibration exclude each other: remove one of them")
    if frame.is_dir():
        raise DatasetError(
            f"{frame} is a folder: inspect takes one image; for a folder use palpate-edge follow"
        )
    image = read_image(frame)
    if calibration_path is not None:
        from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
        from palpate_edge.diagnostics.pipeline_figures import draw_steps  # noqa: PLC0415
        from palpate_edge.diagnostics.pipeline_steps import contact_text, take_steps  # noqa: PLC0415

        steps = take_steps(image, load_calibration(calibration_path), str(frame))
        write_picture(output, draw_steps(steps), DatasetError)
        click.echo(f"{output}: paper's method: {contact_text(steps.paper)}")
        if steps.corrected is not None:
            click.echo(f"  corrected: {contact_text(steps.corrected)}")
        return
    from palpate_edge.diagnostics.figures import draw_beads  # noqa: PLC0415
    from palpate_edge.vision.unknown_layout import beads_without_layout  # noqa: PLC0415

    blobs, appearance, size_px = beads_without_layout(image, diameter)
    if not len(blobs.strength):
        raise DatasetError(
            f"{frame}: no beads found: take a sharp picture of the untouched skin, "
            + ("or leave out --diameter" if diameter else "or give the beads' --diameter in pixels")
        )
    write_picture(output, draw_beads(image, blobs.position_px, size_px), DatasetError)
    kind = "bright" if appearance.bright else "dark"
    click.echo(f"{output}: {len(blobs.strength)} {kind} beads of about {size_px:.0f} px")
