"""The press sample by region and by force, both methods, beside the paper's Table 1; and the goals."""

from __future__ import annotations

from collections.abc import Sequence

from bench.accuracy_report import (
    Section,
    coverage_shortcoming,
    lighter_missed,
    number,
    paragraph,
    refused,
    table,
    wrong_flags,
)
from palpate_edge.calibration.evaluation import PAPER_ERRORS_MM, Band, Figures

COMMAND = "`palpate-edge evaluate press-sample --calibration sample.cal --method {corrected,paper}`"
REGION_HEAD = ("region", "presses", "Table 1", "paper's method", "corrected", "median", "p95", "max")
FORCE_HEAD = ("", "presses", "corrected N", "%", "deg", "paper's method N", "%", "deg")


def section(corrected: Figures, paper: Figures) -> Section:
    """Tables of one calibration's two methods."""
    regions = zip(corrected.regions, paper.regions, PAPER_ERRORS_MM, strict=True)
    rows = [
        (ours.name, str(ours.count), number(printed, 3), number(theirs.mean_mm, 3), *_position(ours))
        for ours, theirs, printed in regions
    ]
    means = sum(PAPER_ERRORS_MM) / len(PAPER_ERRORS_MM), paper.overall.mean_mm
    overall = corrected.overall
    rows.append(("all", str(overall.count), *(number(mean, 3) for mean in means), *_position(overall)))
    where = paragraph(f"""
        The press sample's test split, calibrated with all of its train presses. Regions are those
        of the paper's Fig. 8b, degrees above the base plane. "Table 1" is what the paper printed
        for its own sensor ("all" is the mean of the five); "paper's method" is the same method
        here, on this sensor. Errors are in mm. {COMMAND}.
        """)
    force = paragraph(f"""
        Force errors of the same run: root mean square of the force vector's error, in N and in per
        cent of the largest force ({corrected.largest_force_N:.2f} N), and the mean angle between
        the given and the true force where that is above a quarter of the largest. The paper's
        method knows no shear.
        """)
    flags = paragraph(f"""
        Contact flag wrong: corrected {wrong_flags(corrected)}, paper's method {wrong_flags(paper)} of
        {corrected.confusion.judged} and {paper.confusion.judged} frames without touch or with one of
        {corrected.confusion.threshold_N:.3f} N or more; lighter ones missed: {lighter_missed(corrected)} and
        {lighter_missed(paper)}. Refused: {refused(corrected)} and {refused(paper)}.
        """)
    parts = ["## By region", where, table(REGION_HEAD, rows), force]
    parts += [table(FORCE_HEAD, _forces(corrected, paper)), flags]
    return Section("\n\n".join(parts), _shortcomings(corrected, paper))


def goals(corrected: Figures, moving: Sequence[Figures], twenty: Band, hard: Band) -> Section:
    """The goals set beforehand beside the figures; `moving`: of the sequences; `hard`: flicker, hidden beads
    and JPEG 60 together."""
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
            f"contact flag wrong, {judged} frames without touch or with one of at least "
            f"{corrected.confusion.threshold_N:.3f} N, %",
            100 * wrong / judged,
            1.0,
        ),
        (
            f"the same with the {lighter} lighter touches, %",
            100 * (wrong + missed_below) / (judged + lighter),
            1.0,
        ),
    )
    rows = [
        (name, f"<= {goal:g}", number(value), "yes" if value is not None and value <= goal else "no")
        for name, value, goal in figures
    ]
    missed = tuple(
        f"The goal for {name} is missed: {value}, not {goal}."
        for name, goal, value, met in rows
        if met == "no"
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
        f"region {region}: {band.mean_mm:.2f} mm against {printed:.2f}"
        for region, (band, printed) in enumerate(pairs, start=1)
        if band.mean_mm is not None and band.mean_mm > printed
    ]
    text = f"The paper's method is worse here than the paper printed for its sensor in {'; '.join(worse)}."
    few = min(band.count for band in corrected.regions)
    return (
        *((text,) if worse else ()),
        f"The sample's test split is small: the smallest region holds {few} presses.",
        *coverage_shortcoming("Press sample", corrected.overall.covered_percent, corrected.overall.count),
    )
