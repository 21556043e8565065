"""Errors on the press sample by region and force, for both methods and the paper's Table 1; the goals."""

from __future__ import annotations

from collections.abc import Sequence

from bench.accuracy_report import (
    Section,
    coverage_shortcoming,
    lighter_missed,
    number,
    paragraph,
    rejected,
    table,
    wrong_flags,
)
from palpate_edge.calibration.evaluation import PAPER_ERRORS_MM, Band, Figures

COMMAND = "`palpate-edge evaluate press-sample --calibration sample.cal --method {corrected,paper}`"
REGION_HEAD = ("region", "presses", "Table 1", "paper's method", "corrected", "median", "p95", "max")
FORCE_HEAD = ("", "presses", "corrected N", "%", "deg", "paper's method N", "%", "deg")


def section(corrected: Figures, paper: Figures) -> Section:
    """Return the tables of both methods with one calibration."""
    regions = zip(corrected.regions, paper.regions, PAPER_ERRORS_MM, strict=True)
    rows = [
        (ours.name, str(ours.count), number(printed, 3), number(theirs.mean_mm, 3), *_position(ours))
        for ours, theirs, printed in regions
    ]
    means = sum(PAPER_ERRORS_MM) / len(PAPER_ERRORS_MM), paper.overall.mean_mm
    overall = corrected.overall
    rows.append(("all", str(overall.count), *(number(mean, 3) for mean in means), *_position(overall)))
    where = paragraph(f"""
        Test split of the press sample; the calibration uses all train presses. The regions are those of
        the paper's Fig. 8b, in degrees above the base plane. "Table 1" gives the paper's errors on its
        own sensor ("all" is the mean of the five regions), "paper's method" those of the same method on
        this sensor. Errors are in mm. Command: {COMMAND}.
        """)
    force = paragraph(f"""
        Force errors of the same run: root mean square of the force vector's error, in N and in per
        cent of the largest force ({corrected.largest_force_N:.2f} N), and the mean angle between
        estimated and true force for forces above a quarter of the largest. The paper's method does not
        estimate shear.
        """)
    flags = paragraph(f"""
        Wrong contact flags: corrected {wrong_flags(corrected)} of {corrected.confusion.judged}, paper's
        method {wrong_flags(paper)} of {paper.confusion.judged} frames (without contact, or with a force
        of at least {corrected.confusion.threshold_N:.3f} N). Missed contacts below that force:
        {lighter_missed(corrected)} and {lighter_missed(paper)}. Rejected frames: {rejected(corrected)} and
        {rejected(paper)}.
        """)
    parts = ["## By region", where, table(REGION_HEAD, rows), force]
    parts += [table(FORCE_HEAD, _forces(corrected, paper)), flags]
    return Section("\n\n".join(parts), _shortcomings(corrected, paper))


def goals(corrected: Figures, moving: Sequence[Figures], twenty: Band, hard: Band) -> Section:
    """Compare the figures with the goals.

    moving: figures of the sequences; twenty: with 20 presses; hard: with flicker, hidden beads and JPEG 60.
    """
    overall = corrected.overall
    flags = [figures.confusion for figures in (corrected, *moving)]
    lighter = sum(flag.touches_below for flag in flags)
    judged, wrong = sum(flag.judged for flag in flags), sum(flag.wrong for flag in flags)
    missed_below = sum(flag.missed_below for flag in flags)
    figures = (
        ("position, all train presses, mean, mm", overall.mean_mm, 0.30),
        ("position, all train presses, p95, mm", overall.p95_mm, 1.0),
        ("position, 20 presses, mean, mm", twenty.mean_mm, 0.6),
        ("force RMSE, % of the largest", overall.force_rmse_percent, 1.5),
        ("force direction, mean, deg", overall.direction_deg, 5.0),
        ("position, flicker, up to 12 beads hidden and JPEG 60, mean, mm", hard.mean_mm, 0.9),
        (
            f"wrong contact flags, {judged} frames without contact or with at least "
            f"{corrected.confusion.threshold_N:.3f} N, %",
            100 * wrong / judged,
            1.0,
        ),
        (
            f"wrong contact flags including {lighter} lighter contacts, %",
            100 * (wrong + missed_below) / (judged + lighter),
            1.0,
        ),
    )
    rows = [
        (name, f"<= {goal:g}", number(value), "yes" if value is not None and value <= goal else "no")
        for name, value, goal in figures
    ]
    missed = tuple(
        f"Goal not met: {name}: {value}, goal {goal}." for name, goal, value, met in rows if met == "no"
    )
    return Section("## Goals\n\n" + table(("", "goal", "figure", "met"), rows), missed)


def _position(band: Band) -> tuple[str, ...]:
    return tuple(number(value, 3) for value in (band.mean_mm, band.median_mm, band.p95_mm, band.max_mm))


def _forces(corrected: Figures, paper: Figures) -> list[tuple[str, ...]]:
    pairs = zip((*corrected.forces, corrected.overall), (*paper.forces, paper.overall), strict=True)
    return [(ours.name, str(ours.count), *_force(ours), *_force(theirs)) for ours, theirs in pairs]


def _force(band: Band) -> tuple[str, ...]:
    return number(band.force_rmse_N, 3), number(band.force_rmse_percent), number(band.direction_deg)


def _shortcomings(corrected: Figures, paper: Figures) -> tuple[str, ...]:
    pairs = list(zip(paper.regions, PAPER_ERRORS_MM, strict=True))
    worse = [
        f"region {region} {band.mean_mm:.2f} mm instead of {printed:.2f}"
        for region, (band, printed) in enumerate(pairs, start=1)
        if band.mean_mm is not None and band.mean_mm > printed
    ]
    text = f"The paper's method has larger errors on this sensor than in the paper: {'; '.join(worse)}."
    few = min(band.count for band in corrected.regions)
    return (
        *((text,) if worse else ()),
        f"The sample's test split is small: the smallest region contains {few} presses.",
        *coverage_shortcoming("Press sample", corrected.overall.covered_percent, corrected.overall.count),
    )
