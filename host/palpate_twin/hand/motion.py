"""What hand and object really did, as a file: the truth that a run of the demo is measured against."""

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
TIPS = 3
PERIOD_US = 20_000
"""Of the hand's own time, from row to row."""
MOVED_RAD = 1e-3


@dataclass(frozen=True, slots=True)
class TrueMotion:
    """stamps_us (n,), Unix time of the hand; held_us (n,): how far that is behind the machine's; q_rad
    (n, nq); pose (n, 7), the object's place in m and its quaternion (w first) in the hand's frame; slip_mm,
    force_N, friction_N (n, 3): of each tip the path of its skin against the object so far, normal and
    tangential force."""

    stamps_us: Array
    held_us: Array
    q_rad: Array
    pose: Array
    slip_mm: Array
    force_N: Array
    friction_N: Array

    @property
    def rotations(self) -> Array:
        """(n, 3, 3): the object's axes, as columns, in the hand's frame."""
        flat = np.zeros((len(self.pose), 9))
        for row, quaternion in zip(flat, self.pose[:, 3:], strict=True):
            mujoco.mju_quat2Mat(row, quaternion)
        return flat.reshape(-1, 3, 3)

    def pace(self, first: int, last: int) -> float:
        """From row to row, the hand's own time over the machine's: less than 1 where it had to wait."""
        machine_us = self.stamps_us + self.held_us
        clock_us = float(machine_us[last] - machine_us[first])
        return float(last - first) * PERIOD_US / clock_us if clock_us > 0.0 else 1.0


class MotionFile:
    """A CSV of the motion, a row a call."""

    def __init__(self, path: Path, joint_names: Sequence[str]) -> None:
        """Raises ConfigError where `path` cannot be written."""
        try:
            self._file = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise ConfigError(f"{path} cannot be written: {error.strerror}: give another --truth") from None
        self._write: Callable[[list[str]], object] = csv.writer(self._file, lineterminator="\n").writerow
        tips = [name.format(tip) for name in TIP_COLUMNS for tip in range(1, TIPS + 1)]
        self._write(["time_us", "held_us", *(f"q_{name}_rad" for name in joint_names), *POSE_COLUMNS, *tips])

    def __enter__(self) -> MotionFile:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def note(self, stamp_us: int, engine: Engine, held_us: int = 0) -> None:
        """The engine as it is now."""
        at = engine.twin.object_q
        normal_N, tangential_N = np.zeros(TIPS), np.zeros(TIPS)
        for tip, touch in enumerate(engine.touches()):
            if touch is not None:
                normal_N[tip] = touch.normal_force_N
                tangential_N[tip] = np.linalg.norm(touch.friction_N)
        pose = engine.data.qpos[at : at + 7]
        values = np.concatenate((engine.q_rad, pose, 1e3 * engine.slip_m, normal_N, tangential_N))
        self._write([str(stamp_us), str(held_us), *(f"{value:.7g}" for value in values)])


def read_motion(path: Path) -> TrueMotion:
    """Raises DatasetError for a file that is missing or was not written by `MotionFile`; a last line that was
    cut short by a sudden end is left out."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise DatasetError(f"{path} cannot be read: {error.strerror}: run the demo again") from None
    columns = len(lines[0].split(",")) if lines else 0
    rows = [line.split(",") for line in lines[1:]]
    joints = columns - 2 - len(POSE_COLUMNS) - TIPS * len(TIP_COLUMNS)
    try:
        table = np.array([row for row in rows if len(row) == columns], dtype=np.float64)
    except ValueError:
        raise DatasetError(f"{path} is damaged: run the demo again") from None
    if joints < 1 or len(table) < 2:
        raise DatasetError(f"{path} holds no motion: run the demo again")
    ends = np.cumsum([1, 1, joints, len(POSE_COLUMNS), TIPS, TIPS])
    stamps, held, q, pose, slip, force, friction = np.split(table, ends, axis=1)
    return TrueMotion(stamps[:, 0], held[:, 0], q, pose, slip, force, friction)


@dataclass(frozen=True, slots=True)
class FilmCut:
    """rows: of the motion, one a picture; whole_s: what a film without a limit would last."""

    rows: list[int]
    whole_s: float


def film_cut(motion: TrueMotion, rate_Hz: float, longest_s: float) -> FilmCut:
    """So many pictures a second, from half a second before the hand first moves on, `longest_s` at most."""
    moves = np.abs(motion.q_rad - motion.q_rad[0]).max(axis=1) > MOVED_RAD
    begin_us = motion.stamps_us[int(np.argmax(moves))] - 500_000 if moves.any() else motion.stamps_us[0]
    begin_us, end_us = max(begin_us, motion.stamps_us[0]), motion.stamps_us[-1]
    times_us = np.arange(begin_us, min(end_us, begin_us + 1e6 * longest_s), 1e6 / rate_Hz)
    rows = [int(row) for row in np.searchsorted(motion.stamps_us, times_us)]
    return FilmCut(rows, float(end_us - begin_us) / 1e6)
