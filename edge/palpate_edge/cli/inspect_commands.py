"""``palpate-edge inspect`` and ``follow``: pictures of the estimator's steps in a frame, and of a video's
tracks."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.progress import progress_bar

INPUT = click.Path(path_type=Path)
DIAMETER = click.option(
    "--diameter", type=click.FloatRange(4, 200), help="Bead diameter in pixels, if known."
)


@click.command()
@click.argument("frame", type=INPUT)
@click.option("-o", "--output", type=INPUT, required=True, help="Picture to write (.png).")
@click.option(
    "--calibration",
    "calibration_path",
    type=INPUT,
    help="Draw every step from the frame to its contact.",
)
@DIAMETER
def inspect(frame: Path, output: Path, calibration_path: Path | None, diameter: float | None) -> None:
    """Find and draw the beads of one image FRAME.

    No description of the sensor is needed. With --calibration, every step of the paper's and of the corrected
    method is drawn.

    \b
    Examples:
      palpate-edge inspect demo/recording/press/reference/000.jpg -o beads.png
      palpate-edge inspect frame.png -o steps.png --calibration finger-1.cal
    """
    from palpate_edge.datasets.images import read_image  # noqa: PLC0415
    from palpate_edge.diagnostics.canvas import write_picture  # noqa: PLC0415

    if calibration_path is not None and diameter is not None:
        raise click.UsageError("--diameter and --calibration exclude each other: remove one of them")
    image = read_image(frame)
    if calibration_path is not None:
        from palpate_edge.calibration.calibration_file import load_calibration  # noqa: PLC0415
        from palpate_edge.diagnostics.pipeline_figures import draw_steps  # noqa: PLC0415
        from palpate_edge.diagnostics.pipeline_steps import contact_text, take_steps  # noqa: PLC0415

        steps = take_steps(image, load_calibration(calibration_path), str(frame))
        write_picture(output, draw_steps(steps))
        click.echo(f"{output}: paper's method: {contact_text(steps.paper)}")
        if steps.corrected is not None:
            click.echo(f"  corrected: {contact_text(steps.corrected)}")
        return
    from palpate_edge.diagnostics.figures import draw_beads  # noqa: PLC0415
    from palpate_edge.vision.unknown_layout import beads_without_layout  # noqa: PLC0415

    blobs, appearance, size_px = beads_without_layout(image, diameter)
    write_picture(output, draw_beads(image, blobs.position_px, size_px))
    kind = "bright" if appearance.bright else "dark"
    click.echo(f"{output}: {len(blobs.strength)} {kind} beads of about {size_px:.0f} px")


@click.command()
@click.argument("video", type=INPUT)
@click.option("-o", "--output", type=INPUT, required=True, help="Picture of the tracks to write (.png).")
@DIAMETER
def follow(video: Path, output: Path, diameter: float | None) -> None:
    """Track the markers of VIDEO to its end and back.

    VIDEO may be a folder of frames; no description of the sensor is needed. A marker that does not return to
    its start has changed its label.

    \b
    Example:
      palpate-edge follow demo/recording/finger-1/frames.webm -o tracks.png
    """
    from palpate_edge.datasets.recording import open_recording  # noqa: PLC0415
    from palpate_edge.diagnostics.canvas import write_picture  # noqa: PLC0415
    from palpate_edge.diagnostics.figures import draw_followed  # noqa: PLC0415
    from palpate_edge.diagnostics.video_tracking import HOME_PX, follow_video  # noqa: PLC0415

    recording = open_recording(video)
    try:
        with progress_bar("following") as progress:
            followed = follow_video(recording, progress, diameter)
    finally:
        recording.close()
    write_picture(output, draw_followed(followed))
    kind = "bright" if followed.appearance.bright else "dark"
    home, lost = followed.home, followed.lost
    click.echo(f"{output}: {len(lost)} frames, {len(home)} {kind} markers")
    click.echo(
        f"  there and back: {int(home.sum())} of {len(home)} markers within {HOME_PX:g} px of where they "
        f"began, {int(followed.swapped.sum())} in another's place"
    )
    click.echo(f"  both ways agree within {HOME_PX:g} px in {100 * followed.agreement:.2f} % of places")
    click.echo(
        f"  markers lost a frame: {lost.mean():.2f} (most {lost.max()}); whole image searched "
        f"{followed.searches} times in {2 * len(lost)} frames"
    )
