"""``palpate-edge follow``: the tracks of all markers through a video, to its end and back."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.cli.options import INPUT, OUTPUT, diameter_option
from palpate_edge.common.errors import DatasetError
from palpate_edge.common.progress import progress_bar


@click.command()
@click.argument("video", type=INPUT)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Picture of the tracks to write (.png).")
@diameter_option
def follow(video: Path, output: Path, diameter: float | None) -> None:
    """Track the markers of VIDEO to its end and back.

    VIDEO may be a folder of frames; no description of the sensor is needed. A marker that does not return to
    its start has changed its label.

    \b
    Example:
      palpate-edge follow demo/recording/finger-1/frames.webm -o tracks.png
    """
    from palpate_edge.common.picture_file import write_picture  # noqa: PLC0415
    from palpate_edge.datasets.recording import open_recording  # noqa: PLC0415
    from palpate_edge.diagnostics.figures import draw_followed  # noqa: PLC0415
    from palpate_edge.diagnostics.video_tracking import HOME_PX, follow_video  # noqa: PLC0415

    recording = open_recording(video)
    try:
        with progress_bar("following") as progress:
            followed = follow_video(recording, progress, diameter)
    finally:
        recording.close()
    write_picture(output, draw_followed(followed), DatasetError)
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
