"""Measure the estimator's errors on simulated sensors: ``python -m bench.accuracy_twin``.

It writes docs/accuracy-twin.md.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path

import click
import cv2
import numpy as np

from bench.accuracy_report import number, paragraph, rejected, table, wrong_flags
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.measurement import Measured, measure
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.geometry.points import distances
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.tracker import Tracker
from palpate_twin.camera.layouts import IN_TURN
from palpate_twin.camera.look import TwinSensor
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, Shot, single_presses, write_dataset
from palpate_twin.dome.library import load_library

SENSORS = 10
PLAN = Plan(train=200, test=60)
COUNTS = (0, 20, PLAN.train)
FAR_PX = 3.0  # a found bead with a larger error counts as far off
PROCESSES = 2


@dataclass(frozen=True, slots=True)
class Beads:
    """Bead positions of the tracker compared with the truth.

    median_px: median error. mislabelled, far: number of test frames with a bead whose label is wrong, or that
    is far off, if the tracker continues from the frame before, and if it starts from the untouched dome.
    """

    median_px: float
    mislabelled: tuple[int, int]
    far: tuple[int, int]
    frames: int


@dataclass(frozen=True, slots=True)
class Line:
    """Results of one sensor.

    figures: of the test split by number of presses, None if the sensor could not be calibrated; problem: the
    reason.
    """

    name: str
    appearance: str
    figures: dict[int, Figures | None]
    beads: Beads | None
    problem: str = ""


@click.command()
@click.option("--data", type=click.Path(path_type=Path), default=Path("../shared/data"), show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("docs/accuracy-twin.md"))
@click.option("--sensors", type=click.IntRange(1), default=SENSORS, show_default=True)
def main(data: Path, output: Path, sensors: int) -> None:
    """Calibrate and evaluate simulated sensors, and the press sample for comparison.

    It takes 5 to 20 minutes on two cores. OUTPUT is written after each sensor.
    """
    begin = time.monotonic()

    def report_progress(what: str) -> None:
        click.echo(f"{time.monotonic() - begin:4.0f} s  {what}", err=True)

    with tempfile.TemporaryDirectory() as work, ProcessPoolExecutor(PROCESSES) as pool:
        tasks = {pool.submit(_sample, data / "press-sample"): -1}
        # The hexagonal layouts have the most beads and come last.
        for seed in sorted(range(sensors), key=lambda seed: (seed % len(IN_TURN), seed)):
            tasks[pool.submit(_sensor, seed, Path(work) / str(seed))] = seed
        lines: dict[int, Line] = {}
        for task in as_completed(tasks):
            lines[tasks[task]] = task.result()
            report_progress(lines[tasks[task]].name)
            missing = [seed for seed in range(sensors) if seed not in lines]
            _write(output, report([lines[seed] for seed in sorted(lines)], missing))
    report_progress(f"{output} written")


def _write(output: Path, text: str) -> None:
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{output} cannot be written: {error.strerror}") from None


def report(lines: Sequence[Line], missing: Sequence[int]) -> str:
    """Return the page. missing: seeds whose sensors are not done yet."""
    head = paragraph(f"""
        `python -m bench.accuracy_twin` writes this page. It evaluates random sensors of the twin; the number
        before a sensor's name is its seed (`palpate-host simulate dataset -o dome --random-seed SEED`). Each
        sensor is calibrated with 0, 20 and all {PLAN.train} of its train presses and evaluated on {PLAN.test}
        others, as by `palpate-edge calibrate` and `evaluate`. The press sample, which comes from an
        independent simulation, is listed for comparison. Differences have two causes: the twin differs from
        that simulation, and it has properties that the sample lacks (layouts, colours, glare, print). Errors
        on smaller domes are smaller; the radius is given.
        """)
    position = table(
        ("sensor", "appearance", "0 presses: mean mm", "20", "all", "all: p95", "covered %"),
        [
            (
                line.name,
                line.appearance,
                *(_mean(line, count) for count in COUNTS),
                _all(line, "p95_mm"),
                _all(line, "covered_percent", 1),
            )
            for line in lines
        ],
    )
    force = table(
        ("sensor", "20 presses: %", "all: %", "deg", "wrong flags", "rejected", "frames"),
        [
            (
                line.name,
                _force(line, 20),
                _all(line, "force_rmse_percent"),
                _all(line, "direction_deg"),
                *_counts(line),
            )
            for line in lines
        ],
    )
    beads = table(
        ("sensor", "median px", "wrong label: tracked", "single", "far off: tracked", "single", "frames"),
        [
            (
                line.name,
                number(line.beads.median_px, 3),
                *map(str, line.beads.mislabelled),
                *map(str, line.beads.far),
                str(line.beads.frames),
            )
            for line in lines
            if line.beads
        ],
    )
    notes = [f"- {line.name}: {line.problem}." for line in lines if line.problem]
    parts = [
        "# Accuracy on the twin",
        head,
        *(
            [f"Not finished when this page was written: sensors {', '.join(map(str, missing))}."]
            if missing
            else []
        ),
        "## Position",
        position,
        *notes,
        "## Force and contact",
        paragraph("""Force errors are root mean squares in per cent of the largest force of the sensor's test
        presses. Angles, wrong flags and rejected frames are those with all presses."""),
        force,
        "## Beads",
        paragraph(f"""Errors of the tracker's bead positions over the test frames. "wrong label": frames with
        a bead that is nearer to the true place of another one than to its own. "far off": frames with a bead
        more than {FAR_PX:g} px from its true place. "tracked": the tracker continues from the frame before;
        as the presses are independent, it meets jumps that a moving contact does not make. "single": the
        tracker starts from the untouched dome for each frame."""),
        beads,
    ]
    return "\n\n".join(parts) + "\n"


def _sample(folder: Path) -> Line:
    cv2.setNumThreads(1)
    return Line("press sample", "independent twin", _figures(read_dataset(folder)), None)


def _sensor(seed: int, folder: Path) -> Line:
    cv2.setNumThreads(1)
    twin = random_sensor(seed)
    view = CameraView(twin, load_library())
    shots = single_presses(view, PLAN, seed)
    write_dataset(folder, view, shots, PLAN.references, seed)
    dataset = read_dataset(folder)
    name = f"{seed}: {IN_TURN[seed % len(IN_TURN)]}"
    try:
        found = _beads(view, shots, dataset, measure(dataset, ()))
        return Line(name, _appearance(twin), _figures(dataset), found)
    except CalibrationError as error:
        return Line(name, _appearance(twin), dict.fromkeys(COUNTS), None, str(error))


def _figures(dataset: PressDataset) -> dict[int, Figures | None]:
    """Return the figures of the test split by number of train presses; the last count means all."""
    dome = load_dome_model()
    train = dataset.split("train")
    touched = tuple(press for press in train if press.position_mm is not None)
    found: dict[int, Figures | None] = {}
    for count in COUNTS:
        used = train if count == COUNTS[-1] else touched[:count]
        calibration = calibrate(replace(dataset, presses=used), dome=dome)
        found[count] = evaluate_dataset(dataset.folder, "test", calibration, dataset.folder, None)
    return found


def _beads(view: CameraView, shots: Sequence[Shot], dataset: PressDataset, measured: Measured) -> Beads:
    true_reference_px, _ = view.outlines(None)
    reference_px = measured.reference.position_px
    bead_of = distances(reference_px, true_reference_px).argmin(axis=1)
    tracker, single = Tracker(measured.reference), Tracker(measured.reference)
    errors, wrong, far, frames = [], [0, 0], [0, 0], 0
    for shot, press in zip(shots, dataset.presses, strict=True):
        if shot.split != "test":
            continue
        deformation = view.dome.press(shot.press) if shot.press else None
        true_px = view.outlines(deformation)[0][bead_of]
        dark = plane(read_image(dataset.path(press)), measured.registration.appearance)
        single.reset()
        frames += 1
        for which, beads in enumerate((tracker.follow(dark), single.follow(dark))):
            apart_px = distances(beads.position_px, true_px)[beads.found]
            off_px = apart_px[np.arange(len(apart_px)), beads.found.nonzero()[0]]
            wrong[which] += bool((apart_px.min(axis=1) < off_px).any())
            far[which] += bool((off_px > FAR_PX).any())
            if which:
                errors.append(off_px)
    median_px = float(np.median(np.concatenate(errors)))
    return Beads(median_px, (wrong[0], wrong[1]), (far[0], far[1]), frames)


def _appearance(twin: TwinSensor) -> str:
    bead, skin = np.array(twin.look.bead_bgr), np.array(twin.look.skin_bgr)
    kind = "coloured" if np.ptp(bead) > 60 else "light" if bead.mean() > skin.mean() else "dark"
    more = [twin.sensor.camera.model]
    more += ["print"] if twin.look.text else []
    more += ["glare"] if twin.look.glare else []
    return f"{kind}, {twin.sensor.dome.outer_radius_mm:g} mm, " + ", ".join(more)


def _mean(line: Line, count: int) -> str:
    figures = line.figures[count]
    return "-" if figures is None else number(figures.overall.mean_mm)


def _force(line: Line, count: int) -> str:
    figures = line.figures[count]
    return "-" if figures is None else number(figures.overall.force_rmse_percent)


def _all(line: Line, name: str, digits: int = 2) -> str:
    figures = line.figures[COUNTS[-1]]
    return "-" if figures is None else number(getattr(figures.overall, name), digits)


def _counts(line: Line) -> tuple[str, str, str]:
    """Return wrong contact flags, rejected frames and all frames."""
    figures = line.figures[COUNTS[-1]]
    if figures is None:
        return "-", "-", "-"
    return str(wrong_flags(figures)), str(rejected(figures)), str(figures.frames)


if __name__ == "__main__":
    run_cli(main)
