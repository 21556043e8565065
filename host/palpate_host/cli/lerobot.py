"""``palpate-host lerobot``: recorded runs as a LeRobot dataset."""

from __future__ import annotations

from pathlib import Path

import click

from palpate_edge.common.errors import ConfigError
from palpate_host.cli.run import CONFIG
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand


@click.command()
@click.argument(
    "sources", metavar="SOURCE...", nargs=-1, required=True, type=click.Path(path_type=Path, exists=True)
)
@CONFIG
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for the dataset; it must not exist or be empty.",
)
@click.option(
    "--task", required=True, help="Description of the task in a sentence; the same for every episode."
)
@click.option(
    "--fps",
    type=click.IntRange(1, 1000),
    help="Frames per second of the dataset [default: control.tick_Hz of hand.toml].",
)
@click.option(
    "--camera",
    "cameras",
    multiple=True,
    metavar="NAME=FOLDER",
    help="Pictures of a fingertip: a folder of `palpate-edge record`; may be repeated.",
)
def lerobot(
    sources: tuple[Path, ...],
    config_path: Path,
    output: Path,
    task: str,
    fps: int | None,
    cameras: tuple[str, ...],
) -> None:
    """Write recorded runs as a LeRobot dataset, format v3.0, one episode for each SOURCE.

    SOURCE is a bus log, the file of `run --status`, an MCAP file or a folder of `record`.

    Exit status: 0 done, 2 a source or an option cannot be used.

    \b
    Examples:
      palpate-host lerobot run/bus.log --config run/hand.toml -o turns --task "Turn the prism."
      palpate-host lerobot rec1 rec2 --config hand.toml -o set --task Turn --camera finger-1=frames
    """
    from palpate_host.recording.lerobot import episode_of, names_of, write_dataset  # noqa: PLC0415
    from palpate_host.recording.lerobot_video import write_video  # noqa: PLC0415

    if output.exists() and any(output.iterdir()):
        raise ConfigError(f"{output}: is not empty: give another folder or remove it")
    config, hand = load_hand(config_path)
    rate = fps or config.control.tick_Hz
    episodes = []
    names: dict[str, list[str]] = {}
    for source in sources:
        statuses = list(
            read_statuses(source, config, hand, lambda line: click.echo(f"note: {line}", err=True))
        )
        try:
            episodes.append(episode_of(statuses, rate, task))
        except ConfigError as exc:
            raise ConfigError(f"{source}: {exc}") from exc
        names = names_of(statuses[0])
    videos = []
    for text in cameras:
        finger, _, folder = text.partition("=")
        if not finger or not folder:
            raise ConfigError(f"--camera {text}: write NAME=FOLDER, as in finger-1=frames/")
        videos.append(write_video(output, finger, Path(folder), episodes, rate))
    write_dataset(output, episodes, names, rate, videos)
    frames = sum(len(episode.times_us) for episode in episodes)
    click.echo(f"{output}: {len(episodes)} episodes, {frames} frames at {rate} Hz, {len(videos)} videos")
