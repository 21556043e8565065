"""``palpate-host view``: the hand in Rerun's viewer."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import click

from palpate_edge.common.atomic_write import refused_as
from palpate_edge.common.errors import ConfigError
from palpate_host.cli.run import CONFIG
from palpate_host.common.camera_source import named_path, parse_camera
from palpate_host.operator.server import default_control_socket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand

FILE = click.Path(path_type=Path, dir_okay=False)
_OS_ERROR = re.compile(r"os error (\d+)")


@click.command()
@click.argument("source", type=click.Path(path_type=Path, exists=True), required=False)
@CONFIG
@click.option(
    "--socket",
    "socket_path",
    type=click.Path(path_type=Path),
    help="Live: the host's control socket [default: $PALPATE_CONTROL, or that of palpate-host run].",
)
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="NAME=PATH",
    help="Pictures: a folder of `palpate-edge record`, or (live) a ring in shared memory; may be repeated.",
)
@click.option(
    "--calibration",
    "calibrations",
    multiple=True,
    metavar="NAME=FILE",
    help="Find the beads in the pictures of the camera NAME and draw them; may be repeated.",
)
@click.option("--save", "save_path", type=FILE, help="Write a .rrd file and open no viewer.")
@click.option(
    "--connect", "url", metavar="URL", help="Show in a viewer that runs, such as on another machine."
)
@click.option(
    "--duration", "duration_s", type=click.FloatRange(min=0), help="Live: stop after so many seconds."
)
@click.option(
    "--scene-hz",
    type=click.FloatRange(0.1, 1000),
    default=30.0,
    show_default=True,
    help="Redraws of the 3-D hand per second.",
)
def view(
    source: Path | None,
    config_path: Path,
    socket_path: Path | None,
    cameras: tuple[str, ...],
    calibrations: tuple[str, ...],
    save_path: Path | None,
    url: str | None,
    duration_s: float | None,
    scene_hz: float,
) -> None:
    """Show a hand in 3-D with its contacts, forces, joints and status.

    SOURCE is a recording: a bus log, status lines, an MCAP file or a folder of `record`. Without it the hand
    is shown live, from the host's control socket. The viewer is Rerun's own, on this machine.

    \b
    Examples:
      palpate-host view recording --config hand.toml
      palpate-host view traffic.log --config hand.toml --save hand.rrd
      palpate-host view --config hand.toml
      palpate-host view --config hand.toml --camera finger-1=ring --calibration finger-1=finger-1.cal
    """
    import rerun as rr  # noqa: PLC0415 (slow, and an extra)

    from palpate_host.view.blueprint import blueprint  # noqa: PLC0415
    from palpate_host.view.camera_beads import CameraBeads  # noqa: PLC0415
    from palpate_host.view.hand_view import HandView  # noqa: PLC0415
    from palpate_host.view.sources import show_live, show_recording  # noqa: PLC0415

    if source is not None and socket_path is not None:
        raise ConfigError("--socket is for a hand that runs, not for a recording: leave one out")
    if save_path is not None and url is not None:
        raise ConfigError("--save and --connect exclude each other: give one")
    config, hand = load_hand(config_path)
    pictures = [parse_camera(text) for text in cameras]
    files = _calibration_files(calibrations, [picture.name for picture in pictures])
    beads = {name: CameraBeads(path) for name, path in files.items()}
    stream = rr.RecordingStream(f"palpate {config_path.stem}")
    layout = blueprint([picture.name for picture in pictures])
    with _viewer_errors(save_path, url):
        if save_path is not None:
            stream.save(save_path, default_blueprint=layout)
        elif url is not None:
            stream.connect_grpc(url, default_blueprint=layout)
        else:
            stream.spawn(default_blueprint=layout)
        shown = HandView(stream, config, hand, scene_hz)
        if source is not None:
            statuses = read_statuses(source, config, hand, lambda line: click.echo(f"note: {line}", err=True))
            ticks = show_recording(shown, statuses, pictures, beads)
        else:
            socket = socket_path or default_control_socket()
            click.echo(f"view: live, host at {socket}", err=True)
            ticks = show_live(shown, socket, pictures, beads, duration_s)
        stream.flush()
        stream.disconnect()
    click.echo(f"view: {ticks} ticks" + (f" in {save_path}" if save_path is not None else ""))


def _calibration_files(texts: Iterable[str], cameras: Sequence[str]) -> dict[str, Path]:
    """Parse NAME=PATH of each. Raises ConfigError for another form, or a name that no --camera has."""
    found = dict(named_path("--calibration", text, "finger-1=finger-1.cal") for text in texts)
    unknown = [name for name in found if name not in cameras]
    if unknown:
        raise ConfigError(f"--calibration {unknown[0]}: no --camera has this name: give its camera too")
    return found


@contextmanager
def _viewer_errors(save_path: Path | None, url: str | None) -> Iterator[None]:
    """Turn Rerun's errors into ConfigError: it reports a refusal of the file system as ``(os error N)``."""
    try:
        yield
    except (RuntimeError, ValueError) as exc:
        number = _OS_ERROR.search(str(exc))
        if save_path is not None and number is not None:
            with refused_as(save_path, ConfigError):
                raise OSError(int(number[1]), os.strerror(int(number[1]))) from None
        target = "the viewer cannot be started" if url is None else f"no viewer at {url}"
        reason = " ".join(str(exc).split())
        raise ConfigError(f"{target} ({reason}): use --save FILE.rrd and open that file later") from None
