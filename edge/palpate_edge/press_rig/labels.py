"""Labels of a run: places and forces in the fingertip frame, as truth.csv of an ordinary press dataset.

The printer's positions give the contacts in the printer's axes. The pictures give the lean and the turn of
the fingertip in them: the dome model, without a press of this sensor, locates each contact in F within some
tenths of a millimetre and in no preferred direction; the rotation that fits all presses is far more exact.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_edge.calibration.measurement import Measured, measure
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.common.arrays import Array
from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.images import list_images
from palpate_edge.datasets.press_dataset import BOUNDS, COLUMNS, Press, PressDataset
from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Dome
from palpate_edge.press_rig.ball_model import ball_forces, load_ball_model, suits
from palpate_edge.press_rig.dome_place import tangents
from palpate_edge.press_rig.journal import PressRecord, RigJournal
from palpate_edge.press_rig.weighed_force import cone_bounds_N, forces_from_weights, rotation_between

FEWEST_PRESSES = 10
LEAST_WEIGHT_N = 0.1  # lighter presses do not count for the mounting and the stiffness


@dataclass(frozen=True, slots=True)
class LabelReport:
    """Findings of the labelling.

    presses: with a contact. tilt_deg: of the dome's axis against the printer's z axis; turn_deg: of the
    fingertip about it. mounting_off_mm: median distance between the printer's places and the dome model's.
    model_error_percent: of the model's forces, as the scale shows it. unseen: presses that no picture shows
    well.
    """

    presses: int
    tilt_deg: float
    turn_deg: float
    mounting_off_mm: float
    model_error_percent: float
    unseen: int


def label_run(
    folder: Path,
    journal: RigJournal,
    dome: DomeModel,
    progress: Callable[[int], None] = lambda _done: None,
) -> LabelReport:
    """Write truth.csv of a run, complete or not. `progress` counts images.

    Raises DatasetError with fewer than `FEWEST_PRESSES` presses, CalibrationError where the reference frames
    do not show the layout.
    """
    touched = [record for record in journal.records if record.outward is not None]
    if len(touched) < FEWEST_PRESSES:
        raise DatasetError(
            f"{folder} has {len(touched)} presses, labels need {FEWEST_PRESSES}: repeat the command to go on"
        )
    sensor = read_sensor(folder / "sensor.toml")
    outward = np.array([record.outward for record in touched])
    presses = tuple(_unlabelled(record, sensor.dome.outer_radius_mm) for record in journal.records)
    dataset = PressDataset(folder, sensor, tuple(list_images(folder / "reference")), presses)
    measured = measure(dataset, presses, progress)
    seen, directions, model_force = _model_answers(measured, dome.for_markers(sensor.markers.radius_mm))
    at = {record.frame: number for number, record in enumerate(touched)}
    index = np.array([at[frame] for frame in seen], dtype=np.intp)
    weight_N = np.array([record.weight_N for record in touched])
    firm = weight_N[index] > LEAST_WEIGHT_N
    if firm.sum() < FEWEST_PRESSES:
        raise DatasetError(
            f"{folder}: only {firm.sum()} presses are firm and well seen, labels need {FEWEST_PRESSES}: "
            "see palpate-edge inspect for a frame, and press deeper"
        )
    turn = rotation_between(outward[index][firm], directions[firm])
    up = turn[:, 2]
    if suits(sensor.dome, journal.ball_radius_mm):
        model_force, index = _ball_answers(touched, sensor.dome, turn), np.arange(len(touched))
    outward = outward @ turn.T
    force_N = -outward * (weight_N / np.maximum(outward @ up, 0.1))[:, None]
    weight_sd_N = np.array([record.weight_sd_N for record in touched])
    force_N[index], spread = forces_from_weights(model_force, up, weight_N[index], weight_sd_N[index])
    low_N, high_N = cone_bounds_N(outward, up, weight_N, journal.friction)
    off_mm = sensor.dome.outer_radius_mm * np.linalg.norm(
        directions - outward[[at[frame] for frame in seen]], axis=1
    )
    labels = {
        record.frame: _Label(sensor.dome.outer_radius_mm * outward[n], force_N[n], low_N[n], high_N[n])
        for n, record in enumerate(touched)
    }
    _write_truth(folder, journal, labels)
    return LabelReport(
        presses=len(touched),
        tilt_deg=math.degrees(math.acos(min(1.0, float(up[2])))),
        turn_deg=math.degrees(math.atan2(turn[0, 1], turn[0, 0])),
        mounting_off_mm=float(np.median(off_mm[firm])),
        model_error_percent=100 * spread,
        unseen=len(touched) - len(seen),
    )


@dataclass(frozen=True, slots=True)
class _Label:
    """Place (3,) and force (3,) in F, and the limits of the normal force (NaN: none)."""

    place_mm: Array
    force_N: Array
    low_N: float
    high_N: float


def _unlabelled(record: PressRecord, radius_mm: float) -> Press:
    """Return a record as a press at its place in the printer's axes, of unknown force."""
    if record.outward is None:
        return Press(record.frame, "train", record.time_s, None, 0.0, (0.0, 0.0, 0.0), "none", 0)
    x, y, z = record.outward
    place = (radius_mm * x, radius_mm * y, radius_mm * z)
    return Press(record.frame, "train", record.time_s, place, None, None, "ball", 0)


def _model_answers(measured: Measured, dome: DomeModel) -> tuple[list[str], Array, Array]:
    """Return the frames that were measured, and for each the dome model's direction of contact (n, 3) and its
    force (n, 3) for silicone of its own stiffness, in F."""
    reader = measured.reader(dome.markers_radius_mm)
    fields = [reader.read(beads) for _, beads in measured.touches]
    hidden = np.array([field.hidden for field in fields])
    direction, force, _ = fit(None, dome, 1.0).predict(np.array([field.values for field in fields]), hidden)
    for number, field in enumerate(fields):
        turn = rotation_about_z(field.azimuth_rad)
        direction[number], force[number] = turn @ direction[number], turn @ force[number]
    return [press.frame for press, _ in measured.touches], direction, force


def _ball_answers(touched: list[PressRecord], dome: Dome, turn: Array) -> Array:
    """Return the ball model's forces (n, 3) for silicone of its own stiffness, in F.

    turn: rotation (3, 3) from the printer's axes to F.
    """
    outwards = np.array([record.outward for record in touched])
    slides = np.array([record.slide_mm for record in touched])
    slide_mm = np.array([along @ tangents(at) for along, at in zip(slides, outwards, strict=True)]) @ turn.T
    outwards = outwards @ turn.T
    local_mm = np.array([tangents(at) @ moved for at, moved in zip(outwards, slide_mm, strict=True)])
    depth_mm = np.array([record.depth_mm for record in touched])
    return ball_forces(load_ball_model(), dome, outwards, depth_mm, local_mm)


def _write_truth(folder: Path, journal: RigJournal, labels: dict[str, _Label]) -> None:
    """Write truth.csv whole, in the order in which the frames were taken."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*COLUMNS, *BOUNDS])
    probe = f"sphere{journal.ball_radius_mm:g}"
    for record in journal.records:
        start = [record.frame, record.split, f"{record.time_s:.4f}"]
        label = labels.get(record.frame)
        if label is None:
            table.writerow([*start, "", "", "", "0", "0", "0", "0", "none", "0", "", ""])
            continue
        outward = label.place_mm / np.linalg.norm(label.place_mm)
        normal_N = max(0.0, float(-label.force_N @ outward))
        numbers = [f"{value:.4f}" for value in label.place_mm]
        numbers += [f"{value:.5f}" for value in (normal_N, *label.force_N)]
        bounds = ["" if math.isnan(value) else f"{value:.5f}" for value in (label.low_N, label.high_N)]
        table.writerow([*start, *numbers, probe, "0", *bounds])
    write_atomically(folder / "truth.csv", text.getvalue().encode(), DatasetError)
