"""Make a pose dataset of the folders of dexterousrobot/tactile_data_shear, with links to its pictures.

python -m bench.tactip_dataset TRAIN VAL OUTPUT

TRAIN and VAL are folders with targets_images.csv and processed_images/, as data/cr_tactip/surface_3d/
train_data and val_data of a clone. Rows of TRAIN get the split train, those of VAL test. Reference
frames are the pictures of TRAIN that its table does not name (image_0 was taken before the first press), or
else its least deep presses.
``--presses N`` takes N of the train rows, evenly spaced. The pictures have no licence: link, do not copy.
"""

from __future__ import annotations

import argparse
import csv
from pathlib import Path

import cv2
import numpy as np

from bench.linked_poses import LinkedPress, write_linked

LABELS = {
    "depth_mm": "pose_z",
    "tilt_x_deg": "pose_Rx",
    "tilt_y_deg": "pose_Ry",
    "shear_x_mm": "shear_x",
    "shear_y_mm": "shear_y",
    "torsion_deg": "shear_Rz",
}
# Axes of the tables, measured on the train sets: direction of shear in the image, sign by the pins' turn.
AXES = {"cr_tactip": (200, "object"), "franka_tactip_1": (311, "sensor")}
REFERENCES = 5
DIAMETER_PX = 14
PINS = 331


def main() -> None:
    """Write the dataset's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name in ("train", "val", "output"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--presses", type=int, help="number of train rows (default: all)")
    options = parser.parse_args()
    make_dataset(options.train, options.val, options.output, options.presses)


def make_dataset(train: Path, val: Path, output: Path, presses: int | None = None) -> None:
    """Write sensor.toml, truth.csv and links to the pictures."""
    rows = _rows(train)
    references = _references(train, rows)
    kept = (
        rows if presses is None else [rows[at] for at in np.linspace(0, len(rows) - 1, presses).astype(int)]
    )
    linked = [
        LinkedPress(
            f"{split}_{row['sensor_image']}",
            _pictures(folder) / row["sensor_image"],
            split,
            [row[column] for column in LABELS.values()],
        )
        for split, folder, some in (("train", train, kept), ("test", val, _rows(val)))
        for row in some
    ]
    height, width = cv2.imread(str(references[0]), cv2.IMREAD_GRAYSCALE).shape
    sensor = (
        f"[camera]\nwidth = {width}\nheight = {height}\n"
        f'[markers]\ndiameter_px = {DIAMETER_PX}\nlayout = "hexagonal"\ncount = {PINS}\n'
        f"{_axes(train)}"
    )
    write_linked(output, references, LABELS, linked, sensor)


def _axes(train: Path) -> str:
    """Return the section [labels] for a known set, nothing for another one."""
    known = next((AXES[part] for part in train.resolve().parts if part in AXES), None)
    return "" if known is None else f'[labels]\nx_axis_deg = {known[0]}\nmotion_of = "{known[1]}"\n'


def _rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "targets_images.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def _pictures(folder: Path) -> Path:
    return (folder / "processed_images").resolve()


def _references(folder: Path, rows: list[dict[str, str]]) -> list[Path]:
    """Return the pictures that no row names, or those of the least deep presses."""
    named = {row["sensor_image"] for row in rows}
    others = sorted(path for path in _pictures(folder).glob("*.png") if path.name not in named)
    least = sorted(rows, key=lambda row: float(row[LABELS["depth_mm"]]))[:REFERENCES]
    return others or [_pictures(folder) / row["sensor_image"] for row in least]


if __name__ == "__main__":
    main()
