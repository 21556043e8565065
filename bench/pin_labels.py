"""Wrong labels of single pins on real TacTips: ``python -m bench.pin_labels CLONE``.

CLONE is a clone of tactile_data_shear. Each frame is registered a second time by coherent point drift
(point_drift.py) on the blobs that OpenCV's detector finds: nothing of the estimator's detection or matching
is used. The drift starts where the true pose has the markers, and again shifted by one spacing along each of
the lattice's six directions; the likeliest result counts. A label is wrong where the estimator has a marker
more than half a spacing from there.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import click
import cv2
import numpy as np

from bench.accuracy_poses import CASES, Case
from bench.accuracy_report import table
from bench.point_drift import drift
from bench.pose_tears import predicted_displacement
from bench.tactip_dataset import DIAMETER_PX, make_dataset
from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose
from palpate_edge.common.arrays import Array, Image, Mask
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.pose_dataset import PoseDataset, read_pose_dataset
from palpate_edge.estimation.pose.pose_calibration import PoseCalibration
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator
from palpate_edge.geometry.points import distances, spacing

WRONG = 0.5  # spacings between both registrations
START = 0.5  # spacings that the drift's start may be off
DEPTHS_MM = (0, 1, 2, 3, 4, 5, 6)
TURNS_DEG = tuple(range(0, 360, 60))


@dataclass(frozen=True, slots=True)
class CheckedFrame:
    """One frame: whether it was answered, its depth, and its pins that were found and have a wrong label."""

    answered: bool
    depth_mm: float
    found: int
    wrong: int


@click.command()
@click.argument("clone", type=click.Path(path_type=Path))
@click.option("--only", default="cr_tactip, all", help="cases of bench.accuracy_poses with this text")
@click.option("--frames", default=100, help="val frames of each case, evenly spaced")
def main(clone: Path, only: str, frames: int) -> None:
    """Print the share of wrong pin labels by depth, on real TacTips in CLONE."""
    cv2.setNumThreads(1)
    for case in CASES:
        if only in case.title():
            click.echo(f"{case.title()}\n\n{report(_check_case(clone, case, frames))}\n")


def report(checked: Sequence[CheckedFrame]) -> str:
    """Return the figures of frames by depth."""
    rows = []
    for low, high in itertools.pairwise(DEPTHS_MM):
        some = [frame for frame in checked if low <= frame.depth_mm < high]
        answered = [frame for frame in some if frame.answered]
        if answered:
            share = sum(frame.wrong for frame in answered) / sum(frame.found for frame in answered)
            touched = sum(frame.wrong > 0 for frame in answered)
            rows.append(
                (
                    f"{low} to {high} mm",
                    str(len(some)),
                    str(len(answered)),
                    f"{100 * share:.2f} %",
                    str(touched),
                )
            )
    return table(("depth", "frames", "answered", "wrong labels", "frames with one"), rows)


def wrong_labels(rest_px: Array, start_px: Array, blobs_px: Array, marked_px: Array) -> Mask:
    """Return which markers (n,) of one frame bear a wrong label.

    rest_px, start_px, marked_px (n, 2): markers at rest, about where they are, and where the estimator has
    them; blobs_px (m, 2): what was detected.
    """
    pitch_px = float(np.median(spacing(rest_px)))
    shifts = [np.zeros(2), *(_lattice_step(rest_px, np.deg2rad(turn)) for turn in TURNS_DEG)]
    found = [drift(start_px + shift, blobs_px, pitch_px, START * pitch_px) for shift in shifts]
    best = min(found, key=lambda result: result.cost)
    return np.asarray(np.linalg.norm(best.place - marked_px, axis=1) > WRONG * pitch_px)


def _lattice_step(rest_px: Array, turn_rad: float) -> Array:
    """Return the median step (2,) to the neighbours in one of the lattice's six directions."""
    pitch_px = float(np.median(spacing(rest_px)))
    first, second = np.nonzero(distances(rest_px, rest_px) < 1.3 * pitch_px)
    steps = (rest_px[second] - rest_px[first])[first != second]
    angle = np.angle(steps[:, 0] + 1j * steps[:, 1])
    lattice = np.angle(np.exp(6j * angle).mean()) / 6
    near = np.abs(np.angle(np.exp(1j * (angle - lattice - turn_rad)))) < np.deg2rad(30)
    return np.asarray(np.median(steps[near], axis=0))


def _check_case(clone: Path, case: Case, frames: int) -> list[CheckedFrame]:
    train, val = (clone / "data" / case.folder / name for name in (case.train, case.val))
    with tempfile.TemporaryDirectory() as work:
        folder = Path(work) / "dataset"
        make_dataset(train, val, folder, case.presses)
        dataset = read_pose_dataset(folder)
        return _check(dataset, calibrate_pose(dataset), frames)


def _check(dataset: PoseDataset, calibration: PoseCalibration, frames: int) -> list[CheckedFrame]:
    """Check some test frames; where the pose has the markers is learned from all of them."""
    presses, rest_px = dataset.split("test"), calibration.rest_px()
    estimator, twin = PoseEstimator(calibration), PoseEstimator(calibration)
    marked, found, answered = [], [], []
    for number, press in enumerate(presses):
        image = dataset.read(dataset.path(press), grey=True)
        answered.append(estimator.estimate(Frame(image, number, number, press.frame)).valid)
        match = twin.markers(image)
        marked.append(match.position_px)
        found.append(match.found)
    moved_px = (np.array(marked) - rest_px).reshape(len(presses), -1)
    start_px = predicted_displacement(moved_px, np.array([press.values for press in presses]))
    checked = []
    for number in np.linspace(0, len(presses) - 1, min(frames, len(presses))).astype(int).tolist():
        blobs_px = _blobs(dataset.read(dataset.path(presses[number]), grey=True))
        wrong = wrong_labels(rest_px, rest_px + start_px[number].reshape(-1, 2), blobs_px, marked[number])
        depth_mm = presses[number].values[dataset.labels.index("depth_mm")]
        wrong &= found[number]
        checked.append(CheckedFrame(answered[number], depth_mm, int(found[number].sum()), int(wrong.sum())))
    return checked


def _blobs(image: Image) -> Array:
    """Return the bright blobs (m, 2) of a picture by OpenCV's detector."""
    settings = cv2.SimpleBlobDetector.Params()
    settings.blobColor = 255
    settings.minArea, settings.maxArea = (np.pi / 4 * (share * DIAMETER_PX) ** 2 for share in (0.4, 2.0))
    settings.filterByCircularity = settings.filterByConvexity = settings.filterByInertia = False
    settings.minDistBetweenBlobs = DIAMETER_PX / 3
    settings.minThreshold, settings.thresholdStep = 40, 20
    found = cv2.SimpleBlobDetector.create(settings).detect(image)
    return np.array([blob.pt for blob in found])


if __name__ == "__main__":
    run_cli(main)
