"""Figures of an estimator against a press dataset's truth, as docs/press-dataset.md lists them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.calibration_file import check_sensor
from palpate_edge.calibration.quantity_figures import (
    TorsionFigures,
    WeighedFigures,
    force_covered_percent,
    torsion_figures,
    weighed_figures,
)
from palpate_edge.calibration.stopwatch import Stopwatch
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import Press, read_dataset
from palpate_edge.datasets.truth_table import check_split_has_rows
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import Method

REGIONS_DEG = ((15, 30), (30, 45), (45, 60), (60, 75), (75, 90))  # above the base plane, Fig. 8b
POLE_DEG = 90  # region 5 holds its upper end
PAPER_ERRORS_MM = (1.906, 1.683, 1.369, 1.267, 1.152)  # Table 1
DIRECTION_FORCE_SHARE = 0.25  # direction errors are taken at forces above a quarter of the largest


class Band(msgspec.Struct, frozen=True):
    """Errors of the touched frames of one region or force band; None where it holds none."""

    name: str
    count: int
    mean_mm: float | None = None
    median_mm: float | None = None
    p95_mm: float | None = None
    max_mm: float | None = None
    force_rmse_N: float | None = None
    force_rmse_percent: float | None = None
    direction_deg: float | None = None
    covered_percent: float | None = None


class Confusion(msgspec.Struct, frozen=True):
    """Frames by truth and answer; refused frames are in none.

    threshold_N: the calibration's contact threshold, a normal force, None when no press told it;
    touches_below: touches lighter than that, missed_below: those of them that were not seen.
    """

    touch_as_touch: int
    touch_as_none: int
    none_as_none: int
    none_as_touch: int
    threshold_N: float | None
    touches_below: int
    missed_below: int
    lightest_missed_N: float | None
    heaviest_missed_N: float | None

    @property
    def wrong(self) -> int:
        """Frames in which the contact flag is wrong, but for touches below the threshold."""
        return self.touch_as_none - self.missed_below + self.none_as_touch

    @property
    def judged(self) -> int:
        """Frames without touch, and with one not below the threshold."""
        seen = self.touch_as_touch + self.touch_as_none + self.none_as_none + self.none_as_touch
        return seen - self.touches_below


class StageTime(msgspec.Struct, frozen=True):
    stage: str
    median_ms: float
    p99_ms: float


class Figures(msgspec.Struct, frozen=True):
    """All figures of one evaluation."""

    dataset: str
    split: str
    method: str
    frames: int
    largest_force_N: float | None  # None where no force was measured
    overall: Band
    regions: tuple[Band, ...]
    forces: tuple[Band, ...]
    confusion: Confusion
    refused: dict[str, int]
    times: tuple[StageTime, ...]
    torsion: TorsionFigures | None = None
    force_covered_percent: float | None = None
    weighed: WeighedFigures | None = None


@dataclass(frozen=True, slots=True)
class _Answer:
    press: Press
    contact: Contact


def evaluate_dataset(
    folder: Path,
    split: str,
    calibration: Calibration,
    calibration_path: Path,
    method: Method | None,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Figures:
    """Estimate every frame of a split and compare. Raises DatasetError when the split has no row."""
    dataset = read_dataset(folder)
    check_sensor(calibration.sensor, calibration_path, dataset.sensor, folder / "sensor.toml")
    presses = dataset.split(split)
    check_split_has_rows(folder, split, presses)
    estimator = Estimator(calibration, method)
    grey = calibration.appearance.channel == "grey"
    watch = Stopwatch()
    answers = []
    for number, press in enumerate(presses):
        with watch.stage("read image"):
            image = read_image(dataset.path(press), grey=grey)
        with watch.stage("estimate"):
            contact = estimator.estimate(Frame(image, round(1e6 * press.time_s), number, press.frame))
        answers.append(_Answer(press, contact))
        progress(number + 1, len(presses))
    threshold_N = calibration.contact_threshold_N
    return _figures(folder.resolve().name, split, estimator.method, answers, watch, threshold_N)


def write_json(figures: msgspec.Struct, path: Path) -> None:
    """Write the figures of either kind of evaluation for programs."""
    write_atomically(path, msgspec.json.format(msgspec.json.encode(figures), indent=1) + b"\n", DatasetError)


def _figures(
    name: str,
    split: str,
    method: Method,
    answers: Sequence[_Answer],
    watch: Stopwatch,
    threshold_N: float | None,
) -> Figures:
    forces_N = [answer.press.force_N for answer in answers if not answer.press.is_weighed]
    known_N = [float(np.linalg.norm(force_N)) for force_N in forces_N if force_N is not None]
    largest_N = max(known_N) if known_N and len(known_N) == len(forces_N) else None
    valid = [answer for answer in answers if answer.contact.valid]
    both = [a for a in valid if a.press.position_mm is not None and a.contact.position_mm is not None]
    angle = np.array([_angle_above_base_deg(answer.press) for answer in both])
    regions = [
        _band(
            f"region {number} ({low}-{high} deg)",
            _select(both, (angle >= low) & ((angle < high) | (high == POLE_DEG))),
            largest_N,
        )
        for number, (low, high) in enumerate(REGIONS_DEG, start=1)
    ]
    return Figures(
        dataset=name,
        split=split,
        method=method.value,
        frames=len(answers),
        largest_force_N=largest_N,
        overall=_band("all", both, largest_N),
        regions=tuple(regions),
        forces=() if largest_N is None else _force_bands(both, largest_N),
        confusion=_confusion(valid, threshold_N),
        refused=dict(Counter(answer.contact.reason for answer in answers if not answer.contact.valid)),
        times=tuple(StageTime(stage, *watch.median_and_p99_ms(stage)) for stage in watch.stages),
        torsion=torsion_figures([(answer.press, answer.contact) for answer in both]),
        force_covered_percent=force_covered_percent([(answer.press, answer.contact) for answer in both]),
        weighed=weighed_figures([(answer.press, answer.contact) for answer in valid]),
    )


def _force_bands(answers: Sequence[_Answer], largest_N: float) -> tuple[Band, ...]:
    """Return the errors by third of the largest force."""
    force = np.array([np.linalg.norm(answer.press.force_N) for answer in answers])  # type: ignore[arg-type]
    third_of = (3 * force >= largest_N).astype(int) + (3 * force >= 2 * largest_N)
    return tuple(
        _band(f"force {third}/3 to {third + 1}/3", _select(answers, third_of == third), largest_N)
        for third in range(3)
    )


def _band(name: str, answers: Sequence[_Answer], largest_N: float | None) -> Band:
    """largest_N: of the dataset; None leaves all figures of force open."""
    if not answers:
        return Band(name, 0)
    error = np.array([_position_error_mm(answer) for answer in answers])
    radius = [answer.contact.radius95_mm for answer in answers]
    known = [r is not None for r in radius]
    covered = [r is not None and e <= r for r, e in zip(radius, error, strict=True)]
    forces = [a for a in answers if a.contact.force_N is not None and a.press.force_N is not None]
    truth = np.array([answer.press.force_N for answer in forces]).reshape(-1, 3)
    given = np.array([answer.contact.force_N for answer in forces], dtype=np.float64).reshape(-1, 3)
    rmse = float(np.sqrt(((given - truth) ** 2).sum(axis=1).mean())) if forces else None
    size = np.linalg.norm(truth, axis=1) * np.linalg.norm(given, axis=1)
    firm = (np.linalg.norm(truth, axis=1) > DIRECTION_FORCE_SHARE * (largest_N or 0.0)) & (size > 0)
    cosine = (truth * given).sum(axis=1)[firm] / size[firm]
    return Band(
        name=name,
        count=len(answers),
        mean_mm=float(error.mean()),
        median_mm=float(np.median(error)),
        p95_mm=float(np.percentile(error, 95)),
        max_mm=float(error.max()),
        force_rmse_N=rmse,
        force_rmse_percent=100 * rmse / largest_N if rmse is not None and largest_N else None,
        direction_deg=float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean()) if firm.any() else None,
        covered_percent=float(100 * sum(covered) / sum(known)) if any(known) else None,
    )


def _confusion(answers: Sequence[_Answer], threshold_N: float | None) -> Confusion:
    counts = Counter((a.press.touches, a.contact.in_contact) for a in answers)
    missed = [
        answer.press.normal_force_N
        for answer in answers
        if answer.press.touches and answer.press.normal_force_N is not None and not answer.contact.in_contact
    ]
    below = [
        answer
        for answer in answers
        if answer.press.touches
        and answer.press.normal_force_N is not None
        and answer.press.normal_force_N < (threshold_N or 0.0)
    ]
    return Confusion(
        touch_as_touch=counts[True, True],
        touch_as_none=counts[True, False],
        none_as_none=counts[False, False],
        none_as_touch=counts[False, True],
        threshold_N=threshold_N,
        touches_below=len(below),
        missed_below=sum(not answer.contact.in_contact for answer in below),
        lightest_missed_N=min(missed, default=None),
        heaviest_missed_N=max(missed, default=None),
    )


def _select(answers: Sequence[_Answer], chosen: NDArray[np.bool_]) -> list[_Answer]:
    return [answer for answer, take in zip(answers, chosen, strict=True) if take]


def _position_error_mm(answer: _Answer) -> float:
    """Straight line between the two points on the outer sphere."""
    return float(np.linalg.norm(np.subtract(answer.contact.position_mm, answer.press.position_mm)))  # type: ignore[arg-type]


def _angle_above_base_deg(press: Press) -> float:
    x, y, z = press.position_mm or (0.0, 0.0, 1.0)
    return float(np.degrees(np.arctan2(z, np.hypot(x, y))))
