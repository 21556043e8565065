"""Simulated fingertip sensors for a hand: random sensors, pressed and calibrated like real ones."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration, save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.errors import CalibrationError, ConfigError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.calibration import Calibration
from palpate_twin.camera import layouts
from palpate_twin.camera.look import TWIN_FILE, TwinSensor, load_twin
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import FieldLibrary

PRESSES = 60
SEEDS_TO_TRY = 100
RADIUS_TOLERANCE_MM = 0.01


def fingertip_sensors(
    folder: Path,
    names: Sequence[str],
    radius_mm: float,
    seed: int,
    library: FieldLibrary,
    done: Callable[[str], None],
) -> list[tuple[TwinSensor, Calibration]]:
    """Return a sensor and its calibration for each finger; those missing in `folder` are created there.

    radius_mm: radius of the hand's domes. done: called with a text before each step. Raises ConfigError if
    none of the tried seeds gives that radius, or if a sensor in `folder` has a different one.
    """
    candidates = iter(range(1000 * seed, 1000 * seed + SEEDS_TO_TRY))
    to_press = {
        name: _sensor_of_size(candidates, radius_mm)
        for name in names
        if not (folder / name / TWIN_FILE).exists()
    }

    def made(name: str) -> tuple[TwinSensor, Calibration]:
        if name in to_press:
            done(f"{name}: {PRESSES} presses")
            _press(folder, name, CameraView(to_press[name], library), seed)
        return _load(folder, name, radius_mm, done)

    with ThreadPoolExecutor() as pool:
        return list(pool.map(made, names))


def _press(folder: Path, name: str, view: CameraView, seed: int) -> None:
    """Write a sensor's press dataset."""
    part = folder / f"{name}.part"  # renamed once complete; left over by an interrupted run
    shutil.rmtree(part, ignore_errors=True)
    write_dataset(part, view, single_presses(view, Plan(PRESSES, 0), seed), 8, seed)
    part.rename(folder / name)


def _load(
    folder: Path, name: str, radius_mm: float, done: Callable[[str], None]
) -> tuple[TwinSensor, Calibration]:
    """Return a sensor that was pressed, and its calibration, which is made if it is missing."""
    dataset, calibration = folder / name, folder / f"{name}.cal"
    if not _can_load(calibration):
        done(f"{name}: calibration")
        save_calibration(calibrate(read_dataset(dataset), dome=load_dome_model()), calibration)
    twin = load_twin(dataset / TWIN_FILE)
    if abs(twin.sensor.dome.outer_radius_mm - radius_mm) > RADIUS_TOLERANCE_MM:
        raise ConfigError(
            f"{dataset}: dome radius {twin.sensor.dome.outer_radius_mm:g} mm, but the hand's tips have"
            f" {radius_mm:g} mm: give another --output, or remove that folder and {calibration.name}"
        )
    return twin, load_calibration(calibration)


def _can_load(calibration: Path) -> bool:
    """Return whether a calibration file exists that this version of palpate can read."""
    try:
        load_calibration(calibration)
    except CalibrationError:
        return False
    return True


def _sensor_of_size(seeds: Iterator[int], radius_mm: float) -> TwinSensor:
    """Return the next random sensor with 85 beads in rings and the given radius."""
    for seed in seeds:
        twin = random_sensor(seed, layouts.NAMES[0])
        if abs(twin.sensor.dome.outer_radius_mm - radius_mm) <= RADIUS_TOLERANCE_MM:
            return twin
    raise ConfigError(
        f"no random sensor has a dome radius of {radius_mm:g} mm: use a hand with tips of 30 mm, or --direct"
    )
