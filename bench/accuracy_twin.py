"""Write docs/accuracy-twin.md, the estimator on sensors of the twin: ``python -m bench.accuracy_twin``."""

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

from bench.accuracy_report import number, paragraph, refused, table, wrong_flags
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import Figures, evaluate_dataset
from palpate_edge.calibration.measurement import Measured, measure
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.vision.appearance import plane
from palpate_edge.vision.tracker import Tracker
from palpate_twin.camera.layouts import NAMES
from palpate_twin.camera.look import TwinSensor
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, Shot, single_presses, write_dataset
from palpate_twin.dome.library import load_library

SENSORS = 10
PLAN = Plan(train=200, test=60)
COUNTS = (0, 20, PLAN.train)
MISLABELLED_PX = 3.0  # a found bead farther from its true place is another one, or none
PROCESSES = 2


@dataclass(frozen=True, slots=True)
class Beads:
    """Found beads against the twin's own: median error, and test frames with a mislabelled bead, following
    on from the frame before, and each from the untouched dome."""

    median_px: float
    following: int
    apart: int
    frames: int


@dataclass(frozen=True, slots=True)
class Line:
    """One sensor: what it is, figures of its test split by number of presses, None where it cannot be
    calibrated."""

    name: str
    looks: str
    figures: dict[int, Figures | None]
    beads: Beads | None
    trouble: str = ""


@click.command()
@click.option("--data", type=click.Path(path_type=Path), default=Path("../shared/data"), show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("docs/accuracy-twin.md"))
@click.option("--sensors", type=click.IntRange(1), default=SENSORS, show_default=True)
def main(data: Path, output: Path, sensors: int) -> None:
    """Make datasets of simulated sensors, calibrate and evaluate each, and set the press sample beside them
    (5 to 20 minutes of two busy cores); OUTPUT is written anew after each."""
    begin = time.monotonic()

    def say(what: str) -> None:
        click.echo(f"{time.monotonic() - begin:4.0f} s  {what}", err=True)

    with tempfile.TemporaryDirectory() as work, ProcessPoolExecutor(PROCESSES) as pool:
        tasks = {pool.submit(_sample, data / "press-sample"): -1}
        # The hexagonal layouts, which have the most beads, last.
        for seed in sorted(range(sensors), key=lambda seed: (seed % len(NAMES), seed)):
            tasks[pool.submit(_sensor, seed, Path(work) / str(seed))] = seed
        lines: dict[int, Line] = {}
        for task in as_completed(tasks):
            lines[tasks[task]] = task.result()
            say(lines[tasks[task]].name)
            missing = [seed for seed in range(sensors) if seed not in lines]
            _write(output, report([lines[seed] for seed in sorted(lines)], missing))
    say(f"{output} written")


def _write(output: Path, text: str) -> None:
    try:
        output.write_text(text, encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{output} cannot be written: {error.strerror}") from None


def report(lines: Sequence[Line], missing: Sequence[int]) -> str:
    """The page; missing: seeds whose sensors are not done yet."""
    head = paragraph(f"""
        Made by `python -m bench.accuracy_twin`: sensors that the twin makes up, each from
        the seed before its name (`palpate-host simulate dataset -o dome --random-seed SEED`), each calibrated
        with none, 20 and all {PLAN.train} of its train presses and evaluated on {PLAN.test} others, as
        `palpate-edge calibrate` and `evaluate` do. Beside them the press sample, an independent twin's
        sensor: where the two differ, the twin is not yet like it, or has what the sample has not
        (layouts, colours, glare, print). Errors on smaller domes are smaller: see the radius.
        """)
    position = table(
        ("sensor", "looks", "0 presses: mean mm", "20", "all", "all: p95", "covered %"),
        [
            (
                line.name,
                line.looks,
                *(_mean(line, count) for count in COUNTS),
                _all(line, "p95_mm"),
                _all(line, "covered_percent", 1),
            )
            for line in lines
        ],
    )
    force = table(
        ("sensor", "20 presses: %", "all: %", "deg", "flag wrong", "refused", "of"),
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
        ("sensor", "median px", "mislabelled, following", "mislabelled, each apart", "of frames"),
        [
            (
                line.name,
                number(line.beads.median_px, 3),
                str(line.beads.following),
                str(line.beads.apart),
                str(line.beads.frames),
            )
            for line in lines
            if line.beads
        ],
    )
    notes = [f"- {line.name}: {line.trouble}." for line in lines if line.trouble]
    parts = [
        "# Accuracy on the twin",
        head,
        *(
            [f"Not done when this was written: the sensors {', '.join(map(str, missing))}."]
            if missing
            else []
        ),
        "## Position",
        position,
        *notes,
        "## Force and contact",
        paragraph("""Force errors are root mean squares in per cent of the largest force of the sensor's test
        presses; deg, flags and refusals are those with all presses."""),
        force,
        "## Beads",
        paragraph(f"""What the tracker finds against where the twin drew it, over the test frames. A bead more
        than {MISLABELLED_PX:g} px off is taken for another one: single presses are far apart, so that a
        tracker which follows on from the frame before meets jumps that a moving contact does not make."""),
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
    name = f"{seed}: {NAMES[seed % len(NAMES)]}"
    try:
        found = _beads(view, shots, dataset, measure(dataset, ()))
        return Line(name, _looks(twin), _figures(dataset), found)
    except CalibrationError as error:
        return Line(name, _looks(twin), dict.fromkeys(COUNTS), None, str(error))


def _figures(dataset: PressDataset) -> dict[int, Figures | None]:
    """Of the test split, by number of train presses; the last count stands for all there are."""
    dome = load_dome_model()
    train = dataset.split("train")
    touches = tuple(press for press in train if press.position_mm is not None)
    found: dict[int, Figures | None] = {}
    for count in COUNTS:
        own = train if count == COUNTS[-1] else touches[:count]
        calibration = calibrate(replace(dataset, presses=own), dome=dome)
        found[count] = evaluate_dataset(dataset.folder, "test", calibration, dataset.folder, None)
    return found


def _beads(view: CameraView, shots: Sequence[Shot], dataset: PressDataset, measured: Measured) -> Beads:
    at_rest, _ = view.outlines(None)
    start = measured.reference.position_px
    bead_of = np.linalg.norm(start[:, None] - at_rest[None], axis=2).argmin(axis=1)
    tracker, lone = Tracker(measured.reference), Tracker(measured.reference)
    errors, wrong, frames = [], [0, 0], 0
    for shot, press in zip(shots, dataset.presses, strict=True):
        if shot.split != "test":
            continue
        deformation = view.dome.press(shot.press) if shot.press else None
        true_px = view.outlines(deformation)[0][bead_of]
        dark = plane(read_image(dataset.path(press)), measured.registration.appearance)
        lone.reset()
        frames += 1
        for which, beads in enumerate((tracker.follow(dark), lone.follow(dark))):
            off_px = np.linalg.norm(beads.position_px - true_px, axis=1)[beads.found]
            wrong[which] += bool((off_px > MISLABELLED_PX).any())
            if which:
                errors.append(off_px)
    return Beads(float(np.median(np.concatenate(errors))), *wrong, frames)


def _looks(twin: TwinSensor) -> str:
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
    """Wrong contact flags, refused frames, all frames."""
    figures = line.figures[COUNTS[-1]]
    if figures is None:
        return "-", "-", "-"
    return str(wrong_flags(figures)), str(refused(figures)), str(figures.frames)


if __name__ == "__main__":
    run_cli(main)
