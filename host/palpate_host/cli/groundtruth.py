"""``palpate-host groundtruth``: the object's pose by an external camera."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click
import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.picture_file import write_picture
from palpate_edge.common.progress import notes_beside
from palpate_edge.common.signals import stop_event
from palpate_host.groundtruth.frames import camera_frames, is_camera, recorded_frames
from palpate_host.groundtruth.intrinsics import Board, calibrate, read_intrinsics, write_intrinsics
from palpate_host.groundtruth.track import Marker, ObjectSighting, ObjectTracker, draw, refusals, write_csv

FILE = click.Path(path_type=Path, dir_okay=False)
SOURCE = click.argument("source", type=click.Path(path_type=Path, exists=True))
BOARD = click.option(
    "--board",
    type=(int, int, float, float),
    default=(7, 5, 30.0, 22.0),
    show_default=True,
    metavar="ACROSS DOWN SQUARE_MM MARKER_MM",
    help="Squares of the ChArUco board, and sizes as measured on the print.",
)
SIZE = click.option(
    "--size",
    type=(int, int),
    default=(1280, 720),
    show_default=True,
    metavar="WIDTH HEIGHT",
    help="Image size of a camera.",
)
FPS = click.option(
    "--fps", type=click.FloatRange(1, 240), default=30.0, show_default=True, help="Frame rate of a camera."
)
EXPOSURE = click.option(
    "--exposure-us", type=click.IntRange(1), help="Exposure time of a camera, held constant."
)
DURATION = click.option(
    "--duration", "duration_s", type=click.FloatRange(0.1), help="Length of a camera's recording."
)


@click.group()
def groundtruth() -> None:
    """Measure the object's pose by an ArUco marker and an external camera (the paper's Fig. 18).

    SOURCE is a video, a folder of pictures, or a camera (/dev/v4l/by-path/...). Once a camera: print the
    board, calibrate. Then track the marker on the object.

    \b
    palpate-host groundtruth board -o board.png
    palpate-host groundtruth calibrate board.mp4 -o camera.json
    palpate-host groundtruth track run.mp4 --intrinsics camera.json --marker 7 30 -o truth.csv
    """


@groundtruth.command()
@BOARD
@click.option("-o", "--output", type=FILE, required=True, help="Picture to write (.png).")
def board(board: tuple[int, int, float, float], output: Path) -> None:
    """Draw the ChArUco board to print and glue onto something flat. Measure its squares afterwards.

    \b
    Example:
      palpate-host groundtruth board -o board.png
    """
    write_picture(output, _board(board).picture(), ConfigError)
    click.echo(f"{output}")


@groundtruth.command(name="calibrate")
@SOURCE
@BOARD
@SIZE
@FPS
@EXPOSURE
@DURATION
@click.option(
    "-o", "--output", type=FILE, required=True, help="JSON file of intrinsics to write; - is standard output."
)
@click.option("--picture", type=FILE, help="Draw where the board's corners were (.png).")
def calibrate_command(
    source: Path,
    board: tuple[int, int, float, float],
    size: tuple[int, int],
    fps: float,
    exposure_us: int | None,
    duration_s: float | None,
    output: Path,
    picture: Path | None,
) -> None:
    """Calibrate a camera from a video of the calibration board.

    The result is the focal lengths, the image centre and the distortion. Move and tilt the board before the
    camera. A camera is recorded until Ctrl-C or for --duration.

    \b
    Example:
      palpate-host groundtruth calibrate board.mp4 -o camera.json
    """
    frames = (image for _, image in _frames(source, size, fps, exposure_us, duration_s))
    found = calibrate(frames, _board(board))
    write_intrinsics(output, found.intrinsics)
    i = found.intrinsics
    with notes_beside(output):
        click.echo(f"{output}: {i.pictures} pictures, corners {i.rms_px:.2f} px off")
        click.echo(f"fx {i.fx_px:.1f} fy {i.fy_px:.1f} cx {i.cx_px:.1f} cy {i.cy_px:.1f} px")
        for reason, count in found.refused.items():
            click.echo(f"{count} pictures refused: {reason}")
    if picture is not None:
        drawn = np.full((i.height_px, i.width_px, 3), 255, dtype=np.uint8)
        for x, y in found.corners_px:
            cv2.circle(drawn, (round(x), round(y)), 2, (180, 60, 0), -1)
        write_picture(picture, drawn, ConfigError)


@groundtruth.command()
@SOURCE
@SIZE
@FPS
@EXPOSURE
@DURATION
@click.option("--intrinsics", "intrinsics_path", type=FILE, required=True, help="File of `calibrate`.")
@click.option(
    "--marker", type=(int, float), required=True, metavar="ID SIDE_MM", help="On the object, of 4x4_50."
)
@click.option(
    "--base",
    type=(int, float),
    metavar="ID SIDE_MM",
    help="On the hand's base, its x and y along the hand's: angles are then about the hand's axes.",
)
@click.option(
    "-o", "--output", type=FILE, required=True, help="CSV file of poses to write; - is standard output."
)
@click.option("--picture", type=FILE, help="The last picture with the marker drawn in (.png).")
def track(
    source: Path,
    size: tuple[int, int],
    fps: float,
    exposure_us: int | None,
    duration_s: float | None,
    intrinsics_path: Path,
    marker: tuple[int, float],
    base: tuple[int, float] | None,
    output: Path,
    picture: Path | None,
) -> None:
    """Measure the object's pose in every picture.

    Roll, pitch and yaw are relative to the first pose. A rejected picture has its reason in place of a pose.
    The command fails when no picture has a pose.

    \b
    Example:
      palpate-host groundtruth track run.mp4 --intrinsics camera.json --marker 7 30 -o truth.csv
    """
    intrinsics = read_intrinsics(intrinsics_path)
    tracker = ObjectTracker(intrinsics, _marker(marker), None if base is None else _marker(base))
    sights: list[ObjectSighting] = []
    last: Image | None = None
    for time_us, image in _frames(source, size, fps, exposure_us, duration_s):
        sights.append(tracker.look(time_us, image))
        last = image
    write_csv(output, sights)
    if picture is not None and last is not None:
        write_picture(picture, draw(last, sights[-1], intrinsics, marker[1] * 1e-3), ConfigError)
    refused = refusals(sights)
    with notes_beside(output):
        click.echo(f"{output}: {len(sights) - sum(refused.values())} of {len(sights)} pictures have a pose")
        for reason, count in refused.items():
            click.echo(f"{count} refused: {reason}")
    if sum(refused.values()) == len(sights):
        raise ConfigError(f"{source}: no picture has a pose: see the reasons above")


def _frames(
    source: Path, size: tuple[int, int], fps: float, exposure_us: int | None, duration_s: float | None
) -> Iterator[tuple[int, Image]]:
    if not is_camera(source):
        yield from recorded_frames(source)
        return
    with stop_event() as stopped:
        click.echo("Ctrl-C ends it" if duration_s is None else f"for {duration_s:g} s", err=True)
        yield from camera_frames(source, size, fps, exposure_us, stopped, duration_s)


def _board(values: tuple[int, int, float, float]) -> Board:
    across, down, square_mm, marker_mm = values
    return Board(across, down, square_mm * 1e-3, marker_mm * 1e-3)


def _marker(values: tuple[int, float]) -> Marker:
    number, side_mm = values
    if not 0 <= number < 50 or side_mm <= 0:
        raise ConfigError(
            f"marker {number} of {side_mm:g} mm: the dictionary 4x4_50 has 0 to 49, larger than 0"
        )
    return Marker(number, side_mm * 1e-3)
