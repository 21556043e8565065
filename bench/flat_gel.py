"""Make a synthetic pose dataset of a flat marker gel: a sheet of printed dots that a flat disc presses.

python -m bench.flat_gel OUTPUT

The dots move as points of an incompressible elastic half space. Pressure: Boussinesq's point loads
(K. L. Johnson, Contact Mechanics, 1985, section 3.2) in the distribution below a flat punch (section 3.4),
more of it where the disc tilts in. Sideways way and turn: full stick (section 3.7; Reissner and Sagoci,
J. Appl. Phys. 15, 652, 1944). No slip, no edge of the sheet. Pictures are drawn, not recorded.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LABELS = ("depth_mm", "tilt_x_deg", "tilt_y_deg", "shear_x_mm", "shear_y_mm", "torsion_deg")
LOWEST = (0.2, -3.0, -3.0, -1.0, -1.0, -10.0)
HIGHEST = (1.2, 3.0, 3.0, 1.0, 1.0, 10.0)
WIDTH_PX, HEIGHT_PX = 320, 240
PX_PER_MM = 10.0
COLUMNS, ROWS, PITCH_MM = 14, 10, 2.0
DOT_PX = 8.0
DISC_MM = 6.0  # radius
DOTS_BELOW_MM = 2.0  # the surface
STICK = 0.6  # of the surface's tangential motion, at the dots
LIGHT, DARK, NOISE = 190.0, 120.0, 2.5  # grey levels: of the sheet, of a dot below it
REFERENCES = 5


@dataclass(frozen=True)
class FlatGel:
    """The dots of one sheet at rest, (n, 2) mm from the picture's middle, printed with a small error."""

    rest_mm: Array

    @classmethod
    def printed(cls, seed: int) -> FlatGel:
        x, y = np.meshgrid(np.arange(COLUMNS) - (COLUMNS - 1) / 2, np.arange(ROWS) - (ROWS - 1) / 2)
        places = PITCH_MM * np.stack([x.ravel(), y.ravel()], axis=1)
        return cls(places + np.random.default_rng(seed).normal(0, 0.03, places.shape))

    def pressed_mm(self, pose: Array) -> Array:
        """Return the dots (n, 2) under a disc with this pose, in the order of LABELS."""
        depth, tilt_x, tilt_y, shear_x, shear_y, torsion = pose
        slope = np.radians([tilt_y, -tilt_x])  # of depth along x and y, over the disc
        return (
            self.rest_mm
            + _pressure_motion(self.rest_mm, depth, slope)
            + STICK * _stick_motion(self.rest_mm, np.array([shear_x, shear_y]), np.radians(torsion))
        )

    def picture(self, dots_mm: Array, seed: int) -> NDArray[np.uint8]:
        """Return the camera's picture, brighter on one side, with noise."""
        random = np.random.default_rng(seed)
        cover = np.zeros((HEIGHT_PX, WIDTH_PX))
        centre = np.array([(WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2])
        reach = int(DOT_PX)
        step = np.arange(-reach, reach + 1)
        for x, y in centre + PX_PER_MM * dots_mm:
            column, row = round(x) + step, round(y) + step
            column, row = column[(column >= 0) & (column < WIDTH_PX)], row[(row >= 0) & (row < HEIGHT_PX)]
            apart = np.hypot(column[None, :] - x, row[:, None] - y)
            part = cover[row[:, None], column[None, :]]
            cover[row[:, None], column[None, :]] = np.maximum(part, np.clip(DOT_PX / 2 - apart + 0.5, 0, 1))
        light = LIGHT + 25 * np.linspace(-1, 1, WIDTH_PX)
        image = cv2.GaussianBlur(light - DARK * cover, (0, 0), 0.7)
        noisy = image + NOISE * random.standard_normal(image.shape)
        return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def _pressure_motion(at_mm: Array, depth_mm: float, slope: Array) -> Array:
    """Return the motion (n, 2) below a flat disc that presses `depth_mm` deep in its middle."""
    angle = np.arange(24) * 2 * np.pi / 24
    share = (np.arange(8) + 0.5) / 8
    radius = DISC_MM * np.sqrt(1 - share**2)  # rings that carry the same load under an upright disc
    load = np.stack([np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle))], axis=-1).reshape(
        -1, 2
    )
    carried = np.maximum(depth_mm + 2 * load @ slope, 0.0) / len(load)  # the disc does not pull
    off = at_mm[:, None] - load
    distance = np.sqrt(np.square(off).sum(axis=2) + DOTS_BELOW_MM**2)
    strength = 2 * DISC_MM / np.pi * carried * DOTS_BELOW_MM / distance**3
    return np.asarray((strength[:, :, None] * off).sum(axis=1))


def _stick_motion(at_mm: Array, shear_mm: Array, turn_rad: float) -> Array:
    """Return the surface's motion (n, 2) with a disc that is moved sideways and turned."""
    radius = np.maximum(np.linalg.norm(at_mm, axis=1), DISC_MM)
    share = DISC_MM / radius
    moved = (2 / np.pi * np.arcsin(share))[:, None] * shear_mm
    turned = 2 / np.pi * turn_rad * (np.arcsin(share) - share * np.sqrt(1 - share**2))
    return np.asarray(moved + turned[:, None] * np.stack([-at_mm[:, 1], at_mm[:, 0]], axis=1))


def write_gel(output: Path, train: int, test: int, seed: int = 1) -> None:
    """Write the folder of pictures and the table of one sheet."""
    for name in ("reference", "frames"):
        (output / name).mkdir(parents=True)
    gel = FlatGel.printed(seed)
    for number in range(REFERENCES):
        _write(output / "reference" / f"{number}.png", gel.picture(gel.rest_mm, 10_000 * seed + number))
    poses = np.random.default_rng(seed).uniform(LOWEST, HIGHEST, (train + test, len(LABELS)))
    with (output / "truth.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["frame", "split", *LABELS])
        for number, pose in enumerate(poses):
            name = f"{number:04}.png"
            _write(output / "frames" / name, gel.picture(gel.pressed_mm(pose), 10_000 * seed + 100 + number))
            writer.writerow(
                [name, "train" if number < train else "test", *(f"{value:.4f}" for value in pose)]
            )
    (output / "sensor.toml").write_text(
        f"[camera]\nwidth = {WIDTH_PX}\nheight = {HEIGHT_PX}\n[markers]\ncount = {COLUMNS * ROWS}\n"
    )


def _write(path: Path, image: NDArray[np.uint8]) -> None:
    if not cv2.imwrite(str(path), image):
        raise SystemExit(f"{path} cannot be written")


def main() -> None:
    """Write the dataset's folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--train", type=int, default=300, help="presses to calibrate with (default: 300)")
    parser.add_argument("--test", type=int, default=100, help="presses to evaluate with (default: 100)")
    parser.add_argument("--seed", type=int, default=1, help="another seed is another sheet (default: 1)")
    options = parser.parse_args()
    write_gel(options.output, options.train, options.test, options.seed)


if __name__ == "__main__":
    main()
