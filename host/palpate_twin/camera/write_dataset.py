"""Write a press dataset of one sensor (docs/press-dataset.md), together with the true sensor."""

from __future__ import annotations

import csv
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from palpate_edge.common.errors import DatasetError, reason_of
from palpate_edge.datasets.press_dataset import COLUMNS, TORSION
from palpate_edge.datasets.weights_table import NEWTONS_PER_GRAM, WEIGHTS, WeightRow, weights_text
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.jig.jig_plan import Hole, JigSize, plan_holes
from palpate_twin.camera.deformation import ProbePress
from palpate_twin.camera.look import TWIN_FILE, save_twin
from palpate_twin.camera.random_presses import (
    moving_press,
    printed_axes,
    random_press,
    rod_press,
    weighed_press,
)
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.probe import Probe

SCALE_STEP_G = 1.0  # of a kitchen scale
UNTOUCHED = 0.1  # frames without contact, as a fraction of the presses


@dataclass(frozen=True, slots=True)
class Shot:
    """A frame to render: split, time, press (None without contact) and indices of hidden beads.

    is_weighed: a row of weights.csv, not of truth.csv. hole: of a jig, through which a rod pressed.
    weighed_share: the share of the mass that reaches the dome.
    """

    split: str
    time_s: float
    press: ProbePress | None
    hidden: tuple[int, ...] = ()
    is_weighed: bool = False
    hole: Hole | None = None
    weighed_share: float = 1.0


@dataclass(frozen=True, slots=True)
class Plan:
    """Contents of a dataset.

    train, test: numbers of presses; a tenth as many frames without contact are added. hide: largest number of
    beads hidden in a frame. references: number of reference frames. twist: the probe twists about the contact
    normal as well, and truth.csv has the torsion. weights: number of presses at the apex on a kitchen scale,
    for training. rods: number of presses through the holes of the sensor's jig, for training.
    """

    train: int
    test: int
    probes: tuple[Probe, ...] = (Probe.PLATE,)
    hide: int = 0
    references: int = 8
    twist: bool = False
    weights: int = 0
    rods: int = 0


def single_presses(view: CameraView, plan: Plan, seed: int) -> list[Shot]:
    """Return random presses: first train, then test, each followed by the frames without contact; then those
    on a scale."""
    rng = np.random.default_rng([seed, 5])
    shots: list[Shot] = []
    for split, count in (("train", plan.train), ("test", plan.test)):
        presses: list[ProbePress | None] = [
            random_press(view.dome, plan.probes, rng, twisted=plan.twist) for _ in range(count)
        ]
        presses += [None] * round(UNTOUCHED * count)
        for press in presses:
            hidden = _hidden(len(view.twin.bead_mm), plan.hide, rng)
            shots.append(Shot(split, len(shots) / view.twin.sensor.camera.fps, press, hidden))
    rng = np.random.default_rng([seed, 8])
    for _ in range(plan.weights):
        hidden = _hidden(len(view.twin.bead_mm), plan.hide, rng)
        shots.append(Shot("train", 0.0, weighed_press(view.dome, rng), hidden, is_weighed=True))
    return [*shots, *_through_the_jig(view, plan, np.random.default_rng([seed, 9]))]


def _through_the_jig(view: CameraView, plan: Plan, rng: np.random.Generator) -> Iterator[Shot]:
    if not plan.rods:
        return
    radius_mm = view.twin.sensor.dome.outer_radius_mm
    holes = plan_holes(radius_mm, JigSize(2 * radius_mm))
    axes = printed_axes(holes, radius_mm, rng)
    for number in range(plan.rods):
        press, share = rod_press(view.dome, axes[number % len(holes)], rng)
        hidden = _hidden(len(view.twin.bead_mm), plan.hide, rng)
        yield Shot("train", 0.0, press, hidden, True, holes[number % len(holes)], share)


def one_sequence(view: CameraView, plan: Plan, duration_s: float, seed: int) -> list[Shot]:
    """Return the frames of a moving contact, all in the test split."""
    rng = np.random.default_rng([seed, 6])
    fps = view.twin.sensor.camera.fps
    beads = len(view.twin.bead_mm)
    times = [number / fps for number in range(round(duration_s * fps))]
    return [
        Shot(
            "test",
            at_s,
            moving_press(view.dome, plan.probes, at_s, seed, twisted=plan.twist),
            _hidden(beads, plan.hide, rng),
        )
        for at_s in times
    ]


def write_dataset(
    folder: Path,
    view: CameraView,
    shots: Sequence[Shot],
    references: int,
    seed: int,
    progress: Callable[[], None] = lambda: None,
    *,
    torsion: bool = False,
) -> None:
    """Write the dataset into a new folder; `progress` is called after each image.

    torsion: add its column to truth.csv; for presses with twists, as a calibration learns from the column.
    A temporary folder is renamed once it is complete. Raises DatasetError if it cannot be written.
    """
    fresh = folder.with_name(folder.name + ".new")
    if folder.exists():
        raise DatasetError(f"{folder} already exists: remove it or give another folder")
    try:
        shutil.rmtree(fresh, ignore_errors=True)
        (fresh / "reference").mkdir(parents=True)
        (fresh / "frames").mkdir()
        (fresh / "sensor.toml").write_text(sensor_toml(view.twin.sensor), encoding="utf-8")
        save_twin(view.twin, fresh / TWIN_FILE)
        rng = np.random.default_rng([seed, 7])
        for number in range(references):
            image, _ = view.frame(None, rng)
            _save(fresh / "reference" / f"{number:03d}.png", image, view.twin.look.jpeg_quality)
            progress()
        with (fresh / "truth.csv").open("w", newline="", encoding="utf-8") as file:
            truth = csv.writer(file, lineterminator="\n")
            truth.writerow([*COLUMNS, TORSION] if torsion else COLUMNS)
            placed = [shot for shot in shots if not shot.is_weighed]
            for shot, row in zip(placed, _rows(fresh / "frames", view, placed, rng), strict=True):
                truth.writerow([*row, f"{view.torsion_Nmm(shot.press):.5f}"] if torsion else row)
                progress()
        weighed = [shot for shot in shots if shot.is_weighed]
        if weighed:
            rows = [_weigh(fresh / "frames", view, number, shot, rng) for number, shot in enumerate(weighed)]
            (fresh / WEIGHTS).write_text(weights_text(rows), encoding="utf-8")
        fresh.replace(folder)
    except OSError as error:
        raise DatasetError(f"{folder} cannot be written: {reason_of(error)}; give another path") from None


def sensor_toml(sensor: Sensor) -> str:
    """Return the sensor.toml that a user would write for the nominal sensor."""
    dome, markers, camera = sensor.dome, sensor.markers, sensor.camera
    rings = "".join(
        f"  {{theta_deg = {ring.theta_deg:g}, count = {ring.count}, phi0_deg = {ring.phi0_deg:g}}},\n"
        for ring in markers.rings
    )
    lines = [
        "[dome]",
        f"outer_radius_mm = {dome.outer_radius_mm}",
        f"wall_mm = {dome.wall_mm}",
        "",
        "[markers]",
        f"radius_mm = {markers.radius_mm}",
        f"diameter_mm = {markers.diameter_mm}",
        *([f"rings = [\n{rings}]"] if rings else []),
        "",
        "[camera]",
        f'model = "{camera.model}"',
        f"width = {camera.width}",
        f"height = {camera.height}",
        f"matrix = {list(camera.matrix)}",
        f"distortion = {list(camera.distortion)}",
        f"position_mm = {list(camera.position_mm)}",
        f"fps = {camera.fps}",
    ]
    return "\n".join(lines) + "\n"


def _rows(
    folder: Path, view: CameraView, shots: Sequence[Shot], rng: np.random.Generator
) -> Iterator[list[str]]:
    """Write each frame and yield its row of truth.csv."""
    radius_mm = view.twin.sensor.dome.outer_radius_mm
    for number, shot in enumerate(shots):
        image, force_N = view.frame(shot.press, rng, hidden=shot.hidden)
        name = f"{shot.split}_{number:05d}.jpg"
        _save(folder / name, image, view.twin.look.jpeg_quality)
        start = [name, shot.split, f"{shot.time_s:.4f}"]
        if shot.press is None:
            yield [*start, "", "", "", "0", "0", "0", "0", "none", str(len(shot.hidden))]
            continue
        outward = shot.press.outward
        numbers = [*(f"{value:.4f}" for value in radius_mm * outward), f"{max(0.0, -force_N @ outward):.5f}"]
        numbers += [f"{value:.5f}" for value in force_N]
        yield [*start, *numbers, shot.press.probe.label, str(len(shot.hidden))]


def _weigh(folder: Path, view: CameraView, number: int, shot: Shot, rng: np.random.Generator) -> WeightRow:
    """Write the frame of a press on a scale or by a weight; return its row, in steps of the scale."""
    assert shot.press is not None
    image, force_N = view.frame(shot.press, rng, hidden=shot.hidden)
    name = f"weight_{number:05d}.jpg"
    _save(folder / name, image, view.twin.look.jpeg_quality)
    mass_g = max(0.0, float(-force_N @ shot.press.outward)) / NEWTONS_PER_GRAM / shot.weighed_share
    place = () if shot.hole is None else (shot.hole.theta_deg, shot.hole.phi_deg)
    return WeightRow(name, round(mass_g / SCALE_STEP_G) * SCALE_STEP_G, shot.split, *place)


def _hidden(beads: int, most: int, rng: np.random.Generator) -> tuple[int, ...]:
    if not most:
        return ()
    return tuple(rng.choice(beads, int(rng.integers(0, most + 1)), replace=False).tolist())


def _save(path: Path, image: NDArray[np.uint8], jpeg_quality: int) -> None:
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality] if path.suffix == ".jpg" else []
    ok, data = cv2.imencode(path.suffix, image, options)
    assert ok
    path.write_bytes(data.tobytes())
