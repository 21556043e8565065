"""Pose dataset: images of a sensor with a flat object pressed on it in known poses (docs/own-sensor.md)."""

from __future__ import annotations

import csv
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.contact_quantities import POSE_LABELS
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.images import list_images, read_sized_image
from palpate_edge.datasets.picture_sensor_file import GUIDE, read_picture_sensor
from palpate_edge.datasets.recording import ImageRecording, Recording, open_recording
from palpate_edge.datasets.truth_table import (
    check_frame_and_split,
    check_length,
    finite_number,
    read_rows,
)
from palpate_edge.geometry.picture_sensor import PictureSensor

FILL_OR_DROP = ": fill every row or drop the column"


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
        return read_sized_image(path, self.sensor.image_size_px, grey=grey)


def is_pose_dataset(folder: Path) -> bool:
    """Return whether a folder's truth.csv has pose labels and no contact places, so that it needs no dome."""
    header = _header(folder)
    return "x_mm" not in header and any(label in header for label in POSE_LABELS)


def has_both_labels(folder: Path) -> bool:
    """Return whether a folder's truth.csv has pose labels and contact places."""
    header = _header(folder)
    return "x_mm" in header and any(label in header for label in POSE_LABELS)


def _header(folder: Path) -> list[str]:
    """Return the columns of a folder's truth.csv, none when it cannot be read."""
    try:
        with (folder / "truth.csv").open(newline="", encoding="utf-8") as file:
            return next(csv.reader(file), [])
    except (OSError, UnicodeDecodeError, csv.Error):
        return []


def read_pose_dataset(folder: Path) -> PoseDataset:
    """Read a pose dataset's description and truth; images are read when needed.

    Raises DatasetError with file, line and column.
    """
    sensor = read_picture_sensor(folder / "sensor.toml")
    labels, presses = read_pose_truth(folder / "truth.csv")
    mask = folder / "mask.png"
    reference = tuple(list_images(folder / "reference"))
    dataset = PoseDataset(folder, sensor, reference, labels, presses, None)
    if not mask.exists():
        return dataset
    return replace(dataset, mask=np.asarray(dataset.read(mask, grey=True) > 0, dtype=np.uint8))


def open_pose_recording(path: Path, *, grey: bool = True) -> Recording:
    """Open a pose dataset's frames, or any other recording. Raises DatasetError with what was expected."""
    if not is_pose_dataset(path):
        return open_recording(path, grey=grey)
    fps = read_picture_sensor(path / "sensor.toml").camera.fps
    return ImageRecording(list_images(path / "frames"), fps, None, grey)


def read_pose_truth(path: Path) -> tuple[tuple[str, ...], tuple[PosePress, ...]]:
    """Return the labels of a truth.csv and its rows. Raises DatasetError with the line and the column."""
    rows = read_rows(path, GUIDE)
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
        where = f"{path}, line {number}"
        check_length(where, row, header)
        presses.append(_press(where, {name: row[at] for name, at in place.items()}, labels))
    return labels, tuple(presses)


def _press(where: str, cell: dict[str, str], labels: tuple[str, ...]) -> PosePress:
    check_frame_and_split(where, cell["frame"], cell["split"])
    values = tuple(finite_number(where, label, cell[label], FILL_OR_DROP) for label in labels)
    return PosePress(cell["frame"], cell["split"], values)
