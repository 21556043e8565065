"""Errors by number of presses: calibrations from random subsets of the sample's train split."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from bench.accuracy_report import Section, coverage_shortcoming, number, paragraph, table
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Band, evaluate_dataset
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.datasets.press_dataset import PressDataset
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.frame_estimator import Method

COUNTS = (0, 5, 10, 20, 50, 100)
SUBSETS = 3
COMMAND = "`palpate-edge calibrate SUBSET -o subset.cal`, then `palpate-edge evaluate` as above"


@dataclass(frozen=True, slots=True)
class Point:
    """Figures of the test split for one number of presses: one entry per subset, by method."""

    presses: int
    corrected: tuple[Band, ...]
    paper: tuple[Band, ...]


def measure(
    dataset: PressDataset, dome: DomeModel, whole: Calibration, report_progress: Callable[[str], None]
) -> list[Point]:
    """Return all points. whole: calibration with the whole train split."""
    touched = [press for press in dataset.split("train") if press.position_mm is not None]
    points = []
    for count in COUNTS:
        report_progress(f"{count} presses")
        orders = [np.random.default_rng(seed).permutation(len(touched)) for seed in range(SUBSETS)]
        calibrations = [
            calibrate(replace(dataset, presses=tuple(touched[i] for i in sorted(order[:count]))), dome=dome)
            for order in (orders if count else orders[:1])
        ]
        points.append(_point(count, dataset.folder, calibrations))
    return [*points, _point(len(touched), dataset.folder, [whole])]


def overall(points: Sequence[Point], presses: int) -> Band:
    """Return the corrected method's figures for a number of presses, averaged over the subsets."""
    (point,) = (point for point in points if point.presses == presses)
    return _mean(point.corrected)


def section(points: Sequence[Point], picture: str) -> Section:
    rows: list[tuple[str, ...]] = []
    shortcomings: list[str] = []
    for point in points:
        ours, theirs = _mean(point.corrected), _mean(point.paper)
        means = [band.mean_mm for band in point.corrected if band.mean_mm is not None]
        extent = f"{min(means):.2f} to {max(means):.2f}" if len(means) > 1 else "-"
        rows.append(
            (
                str(point.presses),
                number(ours.mean_mm),
                extent,
                number(ours.p95_mm),
                number(ours.force_rmse_percent),
                number(ours.direction_deg),
                number(ours.covered_percent, 1),
                number(theirs.mean_mm),
                number(theirs.force_rmse_percent),
            )
        )
        shortcomings += coverage_shortcoming(
            f"{point.presses} presses", ours.covered_percent, ours.count * len(point.corrected)
        )
    head = (
        "presses",
        "mean mm",
        "subsets",
        "p95 mm",
        "force %",
        "deg",
        "covered %",
        "paper's mm",
        "paper's force %",
    )
    text = paragraph(f"""
        Means over {SUBSETS} random subsets of the train presses (one subset for 0 and
        {points[-1].presses}); "subsets" gives the smallest and the largest of their means. Without
        presses, the correction model is the packaged dome model. It contains no sensor's stiffness,
        so there is no force. "covered" is the share of presses within their 95 % radius. Command:
        {COMMAND}.
        """)
    curve = f"![mean error by number of presses]({picture})"
    parts = ["## Error by number of presses", text, table(head, rows), curve]
    return Section("\n\n".join(parts), tuple(shortcomings))


def draw(points: Sequence[Point], path: Path) -> None:
    """Draw the curve as an SVG picture; the same figures give the same bytes."""
    mpl.rcParams["svg.hashsalt"] = "palpate"
    mpl.rcParams["svg.fonttype"] = "none"
    figure = Figure(figsize=(5.5, 3.2), layout="constrained")
    axes = figure.add_subplot()
    place = range(len(points))
    for name, bands in (
        ("paper's method", [point.paper for point in points]),
        ("corrected", [point.corrected for point in points]),
    ):
        means = [[band.mean_mm for band in subset if band.mean_mm is not None] for subset in bands]
        middle = np.array([np.mean(values) for values in means])
        low, high = np.array([min(values) for values in means]), np.array([max(values) for values in means])
        axes.errorbar(place, middle, [middle - low, high - middle], marker="o", capsize=3, label=name)
    axes.set_yscale("log")
    axes.set_yticks([0.1, 0.2, 0.5, 1, 2, 5], ["0.1", "0.2", "0.5", "1", "2", "5"])
    axes.set_yticks([], minor=True)
    axes.set_xticks(place, [str(point.presses) for point in points])
    axes.set_xlabel("own presses")
    axes.set_ylabel("mean position error, mm")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, format="svg", metadata={"Date": None})


def _point(presses: int, folder: Path, calibrations: Sequence[Calibration]) -> Point:
    def bands(method: Method) -> tuple[Band, ...]:
        return tuple(evaluate_dataset(folder, "test", c, folder, method).overall for c in calibrations)

    return Point(presses, bands(Method.CORRECTED), bands(Method.PAPER))


def _mean(bands: Sequence[Band]) -> Band:
    """Return the mean of each figure."""

    def mean(name: str) -> float | None:
        values = [getattr(band, name) for band in bands]
        return None if None in values else float(np.mean(values))

    names = ("mean_mm", "median_mm", "p95_mm", "max_mm", "force_rmse_N")
    more = ("force_rmse_percent", "direction_deg", "covered_percent")
    return Band("all", bands[0].count, **{name: mean(name) for name in (*names, *more)})
