"""Make a pose dataset of the pictures of mattclifford1/tactip-sensor-IQM-VIS, with links to them.

python -m bench.raw_tactip CLONE OUTPUT

CLONE has data/real/surface_3d/tap/csv_train/: 100 colour pictures of a TacTip with the lamps and the room
around it, each of a press in a known pose, without shear. The five lightest presses are the reference frames,
as no frame is untouched; of the others every fourth gets the split test. The pictures have no licence: link,
do not copy.
"""

from __future__ import annotations

import argparse
import csv
import math
from pathlib import Path

from bench.linked_poses import LinkedPress, write_linked

FOLDER = Path("data/real/surface_3d/tap/csv_train")
LABELS = {"depth_mm": "pose_3", "tilt_x_deg": "pose_4", "tilt_y_deg": "pose_5"}
REFERENCES, TEST_EVERY = 5, 4
TIP_RADIUS_MM = 20.0
SENSOR = """[camera]
width = 640
height = 480
[markers]
layout = "hexagonal"
count = 331
"""


def main() -> None:
    """Write the dataset's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    for name in ("clone", "output"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--presses", type=int, help="number of train rows (default: all)")
    options = parser.parse_args()
    make_dataset(options.clone / FOLDER, options.output, options.presses)


def make_dataset(source: Path, output: Path, presses: int | None = None) -> None:
    """Write sensor.toml, truth.csv and links to the pictures."""
    with (source / "targets.csv").open(newline="", encoding="utf-8") as file:
        rows = sorted(csv.DictReader(file), key=_touch_mm)
    light, pressed = rows[:REFERENCES], sorted(rows[REFERENCES:], key=lambda row: int(row["pose_id"]))
    test = pressed[TEST_EVERY - 1 :: TEST_EVERY]
    train = [row for row in pressed if row not in test]
    if presses is not None:
        train = [train[at * len(train) // presses] for at in range(presses)]
    pictures = source / "images"
    linked = [
        LinkedPress(
            row["sensor_image"],
            pictures / row["sensor_image"],
            split,
            [row[column] for column in LABELS.values()],
        )
        for split, some in (("train", train), ("test", test))
        for row in some
    ]
    write_linked(output, [pictures / row["sensor_image"] for row in light], LABELS, linked, SENSOR)


def _touch_mm(row: dict[str, str]) -> float:
    """Return how much of the tip a press moves: its depth, and the way of the rim by the tilt."""
    tilt_deg = math.hypot(float(row[LABELS["tilt_x_deg"]]), float(row[LABELS["tilt_y_deg"]]))
    return float(row[LABELS["depth_mm"]]) + TIP_RADIUS_MM * math.radians(tilt_deg) / 3


if __name__ == "__main__":
    main()
