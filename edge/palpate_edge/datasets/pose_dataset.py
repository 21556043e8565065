"""Pose dataset: images of a sensor with a flat object pressed on it in known poses (docs/own-sensor.md)."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.config_file import read_toml
from palpate_edge.common.contact import POSE_LABELS
from palpate_edge.common.errors import DatasetError, reason_of
from palpate_edge.common.type_text import value_text
from palpate_edge.datasets.images import list_images, read_image
from palpate_edge.datasets.press_dataset import SPLITS
from palpate_edge.datasets.recording import ImageRecording, Recording, open_recording
from palpate_edge.datasets.sensor_file import IMAGE_SIDE_PX
from palpate_edge.geometry.picture_sensor import PictureSensor, hexagonal_counts

GUIDE = "docs/own-sensor.md"
MARKER_COUNTS = range(7, 2001)


@dataclass(frozen=True, slots=True)
class PosePress:
    """One row of truth.csv: file name under frames/, split, and a value for each label of the dataset."""

    frame: str
    split: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class PoseDataset:
    """One sensor's recording; labels: those that truth.csv has, in the order of POSE_LABELS.

    mask: True where markers may be, (height, width); None without a mask.png.
    """

    folder: Path
    sensor: PictureSensor
    reference: tuple[Path, ...]
    labels: tuple[str, ...]
    presses: tuple[PosePress, ...]
    mask: Image | None

    def split(self, name: str) -> tuple[PosePress, ...]:
        """Return the presses of one split, ``train`` or ``test``."""
        return tuple(press for press in self.presses if press.split == name)

    def path(self, press: PosePress) -> Path:
        return self.folder / "frames" / press.frame

    def read(self, path: Path, *, grey: bool = False) -> Image:
        """Read an image of the dataset. Raises DatasetError when it has another size than sensor.toml."""
        image = read_image(path, grey=grey)
        width, height = self.sensor.image_size_px
        if image.shape[:2] != (height, width):
            raise DatasetError(
                f"{path} is {image.shape[1]}x{image.shape[0]}, sensor.toml has {width}x{height}: "
                "correct one of them"
            )
        return image


def is_pose_dataset(folder: Path) -> bool:
    """Return whether a folder's truth.csv has pose labels and no contact places, so that it needs no dome."""
    try:
        with (folder / "truth.csv").open(newline="", encoding="utf-8") as file:
            header = next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        return False
    return "x_mm" not in header and any(label in header for label in POSE_LABELS)


def read_pose_dataset(folder: Path) -> PoseDataset:
    """Read a pose dataset's description and truth; images are read when needed.

    Raises DatasetError with file, line and column.
    """
    sensor = read_picture_sensor(folder / "sensor.toml")
    labels, presses = read_pose_truth(folder / "truth.csv")
    mask = folder / "mask.png"
    dataset = PoseDataset(folder, sensor, tuple(list_images(folder / "reference")), labels, presses, None)
    if not mask.exists():
        return dataset
    inside = np.asarray(dataset.read(mask, grey=True) > 0, dtype=np.uint8)
    return PoseDataset(folder, sensor, dataset.reference, labels, presses, inside)


def open_pose_recording(path: Path, *, grey: bool = True) -> Recording:
    """Open a pose dataset's frames, or any other recording. Raises DatasetError with what was expected."""
    if not is_pose_dataset(path):
        return open_recording(path, grey=grey)
    fps = read_picture_sensor(path / "sensor.toml").camera.fps
    return ImageRecording(list_images(path / "frames"), fps, None, grey)


def read_picture_sensor(path: Path) -> PictureSensor:
    """Read a ``sensor.toml`` without a drawing. Raises DatasetError with the key and what is allowed."""
    guide = f"{GUIDE} lists the keys of a sensor without drawing"
    sensor = read_toml(path, PictureSensor, guide=guide, error=DatasetError, trusted=False)
    camera, markers = sensor.camera, sensor.markers
    size, count = markers.diameter_px, markers.count
    checks = [
        ("camera.width", camera.width, camera.width in IMAGE_SIDE_PX, "16 to 8192"),
        ("camera.height", camera.height, camera.height in IMAGE_SIDE_PX, "16 to 8192"),
        ("camera.fps", camera.fps, 0 < camera.fps <= 1000, "above 0 and at most 1000"),
        ("markers.diameter_px", size, size is None or 3 <= size <= 200, "3 to 200, or left out"),
        ("markers.count", count, count is None or count in MARKER_COUNTS, "7 to 2000, or left out"),
    ]
    if markers.layout == "hexagonal":
        fitting = [number for number in hexagonal_counts(max(MARKER_COUNTS)) if number in MARKER_COUNTS]
        allowed = f"one of {', '.join(map(str, fitting[:12]))}, ... for a hexagonal layout"
        checks.append(("markers.count", count, count in fitting, allowed))
    for key, value, is_allowed, allowed in checks:
        if not is_allowed:
            raise DatasetError(f"{path}: {key} = {value} is out of range: it must be {allowed}")
    return sensor


def read_pose_truth(path: Path) -> tuple[tuple[str, ...], tuple[PosePress, ...]]:
    """Return the labels of a truth.csv and its rows. Raises DatasetError with the line and the column."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
    except OSError as error:
        raise DatasetError(f"{path}: {reason_of(error)}") from None
    except (UnicodeDecodeError, csv.Error):
        raise DatasetError(f"{path} is not a CSV file in UTF-8: write it as in {GUIDE}") from None
    header = rows[0] if rows else []
    labels = tuple(label for label in POSE_LABELS if label in header)
    if not labels or not {"frame", "split"} <= set(header) or len(set(header)) != len(header):
        raise DatasetError(
            f"{path}: the first line must have frame, split and any of {', '.join(POSE_LABELS)}, each once"
        )
    place = {column: header.index(column) for column in ("frame", "split", *labels)}
    presses = []
    for number, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise DatasetError(
                f"{path}, line {number} has {len(row)} fields, not {len(header)}: the file may be cut short"
            )
        presses.append(
            _press(f"{path}, line {number}", {name: row[at] for name, at in place.items()}, labels)
        )
    return labels, tuple(presses)


def _press(where: str, cell: dict[str, str], labels: tuple[str, ...]) -> PosePress:
    frame, split = cell["frame"], cell["split"]
    if Path(frame).name != frame or frame in {"", ".."} or "\0" in frame:
        raise DatasetError(f"{where}: frame = {value_text(frame)} is not a file name")
    if split not in SPLITS:
        raise DatasetError(f"{where}: split = {value_text(split)} is not one of train, test")
    return PosePress(frame, split, tuple(_number(where, label, cell[label]) for label in labels))


def _number(where: str, label: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DatasetError(
            f"{where}: {label} = {value_text(text)} is not a finite number: fill every row or drop the column"
        )
    return value
