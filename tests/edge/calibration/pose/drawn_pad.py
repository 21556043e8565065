"""A drawn pad of markers that a plane presses, tilts, shears and twists: its poses are the tests' truth."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import POSE_LABELS


@dataclass(frozen=True)
class DrawnPad:
    """A hexagon of markers, `rings` about the middle one, `pitch_px` apart, bright on dark."""

    rings: int = 4
    pitch_px: float = 20.0
    size_px: int = 240
    diameter_px: float = 9.0
    noise: float = 2.0

    @property
    def count(self) -> int:
        return 1 + 3 * self.rings * (self.rings + 1)

    def rest_px(self) -> Array:
        """Marker places (n, 2) without a press."""
        steps = range(-self.rings, self.rings + 1)
        cells = [(a, b) for a in steps for b in steps if abs(a + b) <= self.rings]
        x = [self.pitch_px * (a + b / 2) for a, b in cells]
        y = [self.pitch_px * math.sqrt(3) / 2 * b for _, b in cells]
        return np.stack([x, y], axis=1) + self.size_px / 2 + 0.3

    def pressed_px(self, pose: Array) -> Array:
        """Marker places under a plane: they spread with depth, more where it tilts in, shear and turn with it
        by as much as they are pressed."""
        depth, tilt_x, tilt_y, shear_x, shear_y, torsion = pose
        off = self.rest_px() - self.size_px / 2
        local = depth + 0.25 * (tilt_x * off[:, 1] + tilt_y * off[:, 0]) / self.pitch_px
        grip = np.exp(-np.square(off / (3.5 * self.pitch_px)).sum(axis=1)) * local / 2
        moved = off * (1 + 0.06 * local * np.exp(-np.square(off / (4 * self.pitch_px)).sum(axis=1)))[:, None]
        turn = np.radians(torsion) * grip
        moved = moved + np.stack([-turn * off[:, 1], turn * off[:, 0]], axis=1)
        moved = moved + grip[:, None] * np.array([4.0 * shear_x, 4.0 * shear_y])
        return np.asarray(moved + self.size_px / 2)

    def picture(self, at_px: Array, seed: int) -> NDArray[np.uint8]:
        """The camera's grey image."""
        row, column = np.mgrid[0 : self.size_px, 0 : self.size_px].astype(np.float32)
        image = np.full((self.size_px, self.size_px), 40, dtype=np.float32)
        half = math.ceil(self.diameter_px / 2) + 1
        for x, y in at_px:
            window = np.s_[
                max(0, int(y) - half) : int(y) + half + 2, max(0, int(x) - half) : int(x) + half + 2
            ]
            distance = np.hypot(column[window] - x, row[window] - y)
            image[window] += 170 * np.clip(self.diameter_px / 2 - distance + 0.5, 0, 1)
        image = cv2.GaussianBlur(np.minimum(image, 210), (0, 0), 0.7)
        noise = self.noise * np.random.default_rng(seed).standard_normal(image.shape, dtype=np.float32)
        return np.asarray(np.clip(np.round(image + noise), 0, 255), dtype=np.uint8)

    def poses(self, count: int, seed: int) -> Array:
        """Random poses (count, 6) in the order of POSE_LABELS."""
        random = np.random.default_rng(seed)
        spans = ((1.0, 3.0), (-3.0, 3.0), (-3.0, 3.0), (-2.0, 2.0), (-2.0, 2.0), (-6.0, 6.0))
        return np.stack([random.uniform(low, high, count) for low, high in spans], axis=1)

    def write(
        self, folder: Path, train: int, test: int, labels: tuple[str, ...] = POSE_LABELS, markers: str = ""
    ) -> Path:
        """A pose dataset with 3 reference frames."""
        for name in ("reference", "frames"):
            (folder / name).mkdir(parents=True, exist_ok=True)
        for number in range(3):
            assert cv2.imwrite(
                str(folder / "reference" / f"{number}.png"), self.picture(self.rest_px(), 900 + number)
            )
        (folder / "sensor.toml").write_text(
            f"[camera]\nwidth = {self.size_px}\nheight = {self.size_px}\n[markers]\n{markers}"
        )
        columns = [POSE_LABELS.index(label) for label in labels]
        with (folder / "truth.csv").open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["frame", "split", *labels])
            for number, pose in enumerate(self.poses(train + test, seed=7)):
                name = f"{number:03}.png"
                assert cv2.imwrite(str(folder / "frames" / name), self.picture(self.pressed_px(pose), number))
                split = "train" if number < train else "test"
                writer.writerow([name, split, *(f"{value:.5f}" for value in pose[columns])])
        return folder
