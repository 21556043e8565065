"""Measure the estimator's errors and write docs/accuracy.md: ``python -m bench.accuracy``."""

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
from bench import accuracy_hard as hard
from bench import accuracy_poses as poses
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
from palpate_edge.estimation.frame_estimator import Method

FINGERS = ("finger-1", "finger-2", "finger-3")


@click.command()
@click.option("--data", type=click.Path(path_type=Path), default=Path("../shared/data"), show_default=True)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), default=Path("docs/accuracy.md"), show_default=True
)
@click.option(
    "--tactip",
    type=click.Path(path_type=Path),
    default=poses.DEFAULT_CLONE,
    show_default=True,
    help="clone of tactile_data_shear; skipped where it is not",
)
def main(data: Path, output: Path, tactip: Path) -> None:
    """Measure position, force and contact errors on the press sample and sequences in DATA.

    Writes the report OUTPUT and its picture next to it.
    """
    cv2.setNumThreads(1)
    begin = time.monotonic()

    def report_progress(what: str) -> None:
        click.echo(f"{time.monotonic() - begin:4.0f} s  {what}", err=True)

    picture = output.with_name(f"{output.stem}-presses.svg")
    sample = read_dataset(data / "press-sample")
    moving = [read_dataset(data / "press-sequences" / finger) for finger in FINGERS]
    sections, points = measure(sample, moving, picture.name, report_progress)
    report_progress("hard light")
    sections.append(hard.section(hard.measure(data)))
    sections.append(poses.section(poses.measure(tactip, report_progress)))
    try:
        output.write_text(report(sections), encoding="utf-8")
        presses.draw(points, picture)
    except OSError as error:
        raise DatasetError(f"{output} cannot be written: {error.strerror}") from None
    report_progress(f"{output} and {picture} written")


def measure(
    sample: PressDataset, moving: Sequence[PressDataset], picture: str, report_progress: Callable[[str], None]
) -> tuple[list[Section], list[presses.Point]]:
    """Return all sections of the report, and the points of its picture."""
    report_progress("calibrating with all train presses")
    dome = load_dome_model()
    whole = calibrate(sample, dome=dome)
    corrected, paper = (
        evaluate_dataset(sample.folder, "test", whole, sample.folder, method)
        for method in (Method.CORRECTED, Method.PAPER)
    )
    report_progress("press sequences")
    sequence_figures = [evaluate_dataset(d.folder, "test", whole, d.folder, None) for d in moving]
    motions = detection.measure([sample, *moving], whole)
    with tempfile.TemporaryDirectory() as work:
        stressed = stress.measure(sample, whole, Path(work), lambda name: report_progress(f"stress: {name}"))
        report_progress("beads")
        bead_errors = beads.measure(sample, Path(work))
    points = presses.measure(sample, dome, whole, report_progress)
    covered = [(figures.dataset, figures) for figures in (corrected, *sequence_figures)]
    sections = [
        regions.goals(
            corrected, sequence_figures, presses.overall(points, 20), stressed[stress.TOGETHER].overall
        ),
        regions.section(corrected, paper),
        presses.section(points, picture),
        sequences.section(sequence_figures),
        stress.section(stressed),
        beads.section(bead_errors),
        detection.section(motions, whole),
        sequences.coverage(covered),
    ]
    return sections, points


def report(sections: list[Section]) -> str:
    """Return the page: introduction, goals, limitations, and the other sections."""
    dome = hashlib.sha256(SHIPPED.read_bytes()).hexdigest()[:16]
    shortcomings = "\n".join(f"- {line}" for section in sections for line in section.shortcomings)
    goals, *others = (section.text for section in sections)
    head = paragraph(f"""
        `make accuracy` (`python -m bench.accuracy`) writes this page from the press sample and the
        press sequences. Their images show a finite-element model of one sensor (640x480, 85 beads),
        not a real dome. The calibration is made from the train split by `palpate-edge calibrate
        press-sample -o sample.cal`. All figures except those of the smallest force are computed by
        the code of `palpate-edge evaluate` from frames that were not used for calibration. Position
        errors are straight distances between two points on the outer sphere (radius 30 mm). They
        apply to the corrected method unless another is named. The dome model is the packaged one
        (sha256 {dome}...). Random seeds are fixed: the same code gives the same page. For computing
        times see `make bench`.
        """)
    return "\n\n".join(["# Accuracy", head, goals, f"## Limitations\n\n{shortcomings}", *others]) + "\n"


if __name__ == "__main__":
    run_cli(main)
