"""``palpate-edge follow``: the tracks of all markers through a video, to its end and back."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from palpate_edge.cli.options import INPUT, OUTPUT, diameter_option
from palpate_edge.common.errors import DatasetError
from palpate_edge.common.progress import progress_bar

if TYPE_CHECKING:
    from palpate_edge.common.arrays import Mask


@click.command()
@click.argument("video", type=INPUT)
@click.option("-o", "--output", type=OUTPUT, required=True, help="Picture of the tracks to write (.png).")
@diameter_option
def follow(video: Path, output: Path, diameter: float | None) -> None:
    """Track the markers of VIDEO to its end and back.

    VIDEO may be a folder of frames; no description of the sensor is needed. A marker that does not return to
    its start has changed its label. One that stays while its neighbours move is counted as no marker.

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
    home, lost, doubtful = followed.home, followed.lost, followed.doubtful
    click.echo(f"{output}: {len(lost)} frames, {len(home)} {kind} markers")
    click.echo(
        f"  there and back: {int((home & ~doubtful).sum())} of {len(home)} markers within {HOME_PX:g} px of "
        f"where they began, {int(followed.swapped.sum())} in another's place"
    )
    click.echo(f"  both ways agree within {HOME_PX:g} px in {100 * followed.agreement:.2f} % of places")
    click.echo(
        f"  markers lost a frame: {lost.mean():.2f} (most {lost.max()}); whole image searched "
        f"{followed.searches} times in {2 * len(lost)} frames"
    )
    if doubtful.any():
        click.echo(
            f"  {int(doubtful.sum())} of {len(home)} are probably no markers (they stay while their "
            f"neighbours move, or are found in less than half of the frames): {numbers(doubtful)}"
        )
    if not followed.moved.any():
        click.echo(f"  no marker moved by more than {HOME_PX:g} px: the video does not test the labels")


def numbers(chosen: Mask, most: int = 12) -> str:
    """Return the indices of the chosen ones, the first `most` of them, as text."""
    indices = [str(index) for index, is_chosen in enumerate(chosen.tolist()) if is_chosen]
    return ", ".join(indices[:most]) + (", ..." if len(indices) > most else "")
