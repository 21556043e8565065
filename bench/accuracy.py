"""Write docs/accuracy.md, all figures of the estimator: ``python -m bench.accuracy`` or ``make accuracy``."""

from __future__ import annotations

import hashlib
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import click
import cv2

from bench import accuracy_beads as beads
from bench import accuracy_detection as detection
from bench import accuracy_presses as presses
from bench import accuracy_regions as regions
from bench import accuracy_sequences as sequences
from bench import accuracy_stress as stress
from bench.accuracy_report import Section, paragraph
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.calibration.training.dome_model import SHIPPED, load_dome_model
from palpate_edge.common.entry_point import run_cli
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import PressDataset, read_dataset
from palpate_edge.estimation.estimator import Method

FINGERS = ("finger-1", "finger-2", "finger-3")


@click.command()
@click.option("--data", type=click.Path(path_type=Path), default=Path("../shared/data"), show_default=True)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default=Path("docs/accuracy.md"), show_default=True
)
def main(data: Path, output: Path) -> None:
    """Measure position, force and contact errors on the press sample and sequences in DATA; write the report
    OUTPUT and beside it its picture."""
    cv2.setNumThreads(1)
    begin = time.monotonic()

    def say(what: str) -> None:
        click.echo(f"{time.monotonic() - begin:4.0f} s  {what}", err=True)

    picture = output.with_name(f"{output.stem}-presses.svg")
    sample = read_dataset(data / "press-sample")
    moving = [read_dataset(data / "press-sequences" / finger) for finger in FINGERS]
    sections, points = measure(sample, moving, picture.name, say)
    try:
        output.write_text(report(sections), encoding="utf-8")
        presses.draw(points, picture)
    except OSError as error:
        raise DatasetError(f"{output} cannot be written: {error.strerror}") from None
    say(f"{output} and {picture} written")


def measure(
    sample: PressDataset, moving: Sequence[PressDataset], picture: str, say: Callable[[str], None]
) -> tuple[list[Section], list[presses.Point]]:
    """All sections of the report, and the points of its picture."""
    say("calibrating with all train presses")
    dome = load_dome_model()
    whole = calibrate(sample, dome=dome)
    corrected, paper = (
        evaluate_dataset(sample.folder, "test", whole, sample.folder, method)
        for method in (Method.CORRECTED, Method.PAPER)
    )
    say("press sequences")
    sequence_figures = [evaluate_dataset(d.folder, "test", whole, d.folder, None) for d in moving]
    motions = detection.measure([sample, *moving], whole)
    with tempfile.TemporaryDirectory() as work:
        stressed = stress.measure(sample, whole, Path(work), lambda name: say(f"stress: {name}"))
        say("beads")
        places = beads.measure(sample, Path(work))
    points = presses.measure(sample, dome, whole, say)
    covered = [(figures.dataset, figures) for figures in (corrected, *sequence_figures)]
    sections = [
        regions.goals(
            corrected, sequence_figures, presses.overall(points, 20), stressed[stress.TOGETHER].overall
        ),
        regions.section(corrected, paper),
        presses.section(points, picture),
        sequences.section(sequence_figures),
        stress.section(stressed),
        beads.section(places),
        detection.section(motions, whole),
        sequences.coverage(covered),
    ]
    return sections, points


def report(sections: list[Section]) -> str:
    """The whole page: introduction, what falls short, and the sections."""
    dome = hashlib.sha256(SHIPPED.read_bytes()).hexdigest()[:16]
    shortcomings = "\n".join(f"- {line}" for section in sections for line in section.shortcomings)
    goals, *others = (section.text for section in sections)
    head = paragraph(f"""
        Made by `make accuracy` (`python -m bench.accuracy`) from the press sample and the press
        sequences: pictures of a finite-element twin of one sensor, 640x480, 85 beads, not of a real
        dome. `palpate-edge calibrate press-sample -o sample.cal` makes the calibration from the
        train split; all figures but those of the smallest force are of frames that no calibration
        has seen, by the code of `palpate-edge evaluate`. Position errors are straight lines between
        two points on the outer sphere (radius 30 mm), of the corrected method where no other is
        named. The dome model is the shipped one (sha256 {dome}...). Random choices have fixed
        seeds: the same code gives the same page. Times are not here: `make bench`.
        """)
    return "\n\n".join(["# Accuracy", head, goals, f"## What falls short\n\n{shortcomings}", *others]) + "\n"


if __name__ == "__main__":
    run_cli(main)
