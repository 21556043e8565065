"""A fingertip's recorded pictures as the video of a LeRobot dataset: a picture for each frame of it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_edge.datasets.recorder import INDEX
from palpate_host.recording.lerobot import FIRST, Episode, Stats, VideoFeature, array_stats

CODEC = "mp4v"  # MPEG-4 Part 2, the codec that OpenCV's wheels encode without another library
SAMPLES = 20
"""Pictures of an episode from which the statistics are made; LeRobot samples too."""
PIXEL_STEP = 4


def write_video(
    folder: Path, finger: str, pictures: Path, episodes: Sequence[Episode], fps: int
) -> VideoFeature:
    """Encode the video of one camera. pictures: a folder of ``palpate-edge record``.

    The picture of a frame is the newest one that was exposed before it; before the first picture, the first.
    Raises ConfigError when the folder has no readable picture or the video cannot be written.
    """
    key = f"observation.images.{finger}"
    times_us, paths = _index(pictures)
    first = _read(paths[0])
    height, width = first.shape[:2]
    path = folder / f"videos/{key}/{FIRST}.mp4"
    make_folder(path.parent, ConfigError)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODEC), fps, (width, height))
    if not writer.isOpened():
        raise ConfigError(f"{path}: OpenCV cannot write a {CODEC} video here: check the folder")
    samples: list[list[Image]] = []
    last, image = -1, first
    for episode in episodes:
        chosen = np.maximum(np.searchsorted(times_us, episode.times_us, side="right") - 1, 0)
        sampled = set(np.linspace(0, len(chosen) - 1, min(SAMPLES, len(chosen))).astype(int).tolist())
        samples.append([])
        for frame, number in enumerate(chosen.tolist()):
            if number != last:
                last, image = number, _read(paths[number])
            if image.shape != first.shape:
                raise ConfigError(
                    f"{paths[number]}: its size differs from {paths[0].name}: give one camera's folder"
                )
            writer.write(image)
            if frame in sampled:
                samples[-1].append(image[::PIXEL_STEP, ::PIXEL_STEP, ::-1])  # RGB
    writer.release()
    info = {
        "video.height": height,
        "video.width": width,
        "video.codec": "mpeg4",
        "video.pix_fmt": "yuv420p",
        "video.fps": fps,
        "video.channels": 3,
        "has_audio": False,
        "is_depth_map": False,
    }
    whole = _stats([image for images in samples for image in images])
    return VideoFeature(key, (height, width, 3), [{**_stats(images)} for images in samples], whole, info)


def _stats(images: Sequence[Image]) -> Stats:
    """Return the statistics of each channel in 0 to 1, in LeRobot's shape (3, 1, 1)."""
    pixels = np.concatenate([image.reshape(-1, 3) for image in images]).astype(np.float64) / 255.0
    stats = array_stats(pixels, len(images))
    return {
        name: values if name == "count" else [[[value]] for value in values] for name, values in stats.items()
    }


def _index(pictures: Path) -> tuple[np.ndarray, list[Path]]:
    index = pictures / INDEX
    try:
        with index.open(newline="") as file:
            rows = [(int(row["exposed_at_us"]), pictures / row["frame"]) for row in csv.DictReader(file)]
    except (OSError, KeyError, ValueError) as exc:
        raise ConfigError(
            f"{index}: no index of recorded frames: give a folder of palpate-edge record"
        ) from exc
    rows = [(time_us, path) for time_us, path in rows if path.exists()]
    if not rows:
        raise ConfigError(f"{index}: none of its pictures exists: give the whole folder of a recording")
    return np.array([time_us for time_us, _ in rows]), [path for _, path in rows]


def _read(path: Path) -> Image:
    image = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if image is None:
        raise ConfigError(f"{path}: not a readable picture: remove its line from the index")
    return np.asarray(image)
