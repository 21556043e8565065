"""CSV file of the true motion of hand and object, with which a demo run is compared."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError, DatasetError
from palpate_twin.hand.engine import Engine

POSE_COLUMNS = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")
TIP_COLUMNS = ("slip_{}_mm", "force_{}_N", "friction_{}_N")
PERIOD_US = 20_000
"""Simulated time between two rows."""
MOVED_RAD = 1e-3
"""Joint angle change from which the hand counts as moving."""


@dataclass(frozen=True, slots=True)
class TrueMotion:
    """Motion of hand and object over time.

    stamps_us (n,): Unix time on the bus clock; held_us (n,): lag of the bus clock behind the machine's; q_rad
    (n, nq): joint angles; pose (n, 7): the object's position in m and its quaternion (w first) in the hand
    frame; slip_mm, force_N, friction_N (n, tips): sliding distance so far, normal and tangential force of
    each tip.
    """

    stamps_us: Array
    held_us: Array
    q_rad: Array
    pose: Array
    slip_mm: Array
    force_N: Array
    friction_N: Array

    @property
    def rotations(self) -> Array:
        """(n, 3, 3): columns are the object's axes in the hand frame."""
        flat = np.zeros((len(self.pose), 9))
        for row, quaternion in zip(flat, self.pose[:, 3:], strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        return flat.reshape(-1, 3, 3)

    def pace(self, first: int, last: int) -> float:
        """Return simulated time over real time between two rows; below 1 if the simulation had to wait."""
        machine_us = self.stamps_us + self.held_us
        real_us = float(machine_us[last] - machine_us[first])
        return float(last - first) * PERIOD_US / real_us if real_us > 0.0 else 1.0


class MotionFile:
    """CSV writer of the motion; each line is flushed."""

    def __init__(self, path: Path, joint_names: Sequence[str], tips: int) -> None:
        """Open the file and write the header. Raises ConfigError if `path` cannot be written."""
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise ConfigError(f"{path} cannot be written: {error.strerror}: give another --truth") from None
        self._write_row: Callable[[list[str]], object] = csv.writer(self._file, lineterminator="\n").writerow
        columns = [name.format(tip) for name in TIP_COLUMNS for tip in range(1, tips + 1)]
        self._write_row(
            ["time_us", "held_us", *(f"q_{name}_rad" for name in joint_names), *POSE_COLUMNS, *columns]
        )

    def __enter__(self) -> MotionFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, stamp_us: int, engine: Engine, held_us: int = 0) -> None:
        """Write the engine's current state as one row."""
        start = engine.twin.object_q
        normal_N, tangential_N = np.zeros((2, len(engine.slip_m)))
        for tip, contact in enumerate(engine.tip_contacts()):
            if contact is not None:
                normal_N[tip] = contact.normal_force_N
                tangential_N[tip] = np.linalg.norm(contact.friction_N)
        pose = engine.data.qpos[start : start + 7]
        values = np.concatenate((engine.q_rad, pose, 1e3 * engine.slip_m, normal_N, tangential_N))
        self._write_row([str(stamp_us), str(held_us), *(f"{value:.7g}" for value in values)])


def read_motion(path: Path) -> TrueMotion:
    """Read a file written by `MotionFile`; a truncated last line is left out.

    Raises DatasetError if the file is missing or damaged.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise DatasetError(f"{path} cannot be read: {error.strerror}: run the demo again") from None
    header = lines[0].split(",") if lines else []
    columns, tips = len(header), sum(name.startswith("slip_") for name in header)
    rows = [line.split(",") for line in lines[1:]]
    joints = columns - 2 - len(POSE_COLUMNS) - tips * len(TIP_COLUMNS)
    try:
        table = np.array([row for row in rows if len(row) == columns], dtype=np.float64)
    except ValueError:
        raise DatasetError(f"{path} is damaged: run the demo again") from None
    if joints < 1 or len(table) < 2:
        raise DatasetError(f"{path} contains no motion: run the demo again")
    ends = np.cumsum([1, 1, joints, len(POSE_COLUMNS), tips, tips])
    stamps, held, q, pose, slip, force, friction = np.split(table, ends, axis=1)
    return TrueMotion(stamps[:, 0], held[:, 0], q, pose, slip, force, friction)


@dataclass(frozen=True, slots=True)
class FilmCut:
    """Rows of a motion that a film shows, one per frame. whole_s: duration of the film without a limit."""

    rows: list[int]
    whole_s: float


def film_cut(motion: TrueMotion, rate_Hz: float, longest_s: float) -> FilmCut:
    """Select the rows of a film that starts 0.5 s before the hand moves and lasts at most `longest_s`."""
    moving = np.abs(motion.q_rad - motion.q_rad[0]).max(axis=1) > MOVED_RAD
    begin_us = motion.stamps_us[int(np.argmax(moving))] - 500_000 if moving.any() else motion.stamps_us[0]
    begin_us, end_us = max(begin_us, motion.stamps_us[0]), motion.stamps_us[-1]
    times_us = np.arange(begin_us, min(end_us, begin_us + 1e6 * longest_s), 1e6 / rate_Hz)
    rows = [int(row) for row in np.searchsorted(motion.stamps_us, times_us)]
    return FilmCut(rows, float(end_us - begin_us) / 1e6)
