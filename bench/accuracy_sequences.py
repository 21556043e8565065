"""The press sequences: the sample's sensor touched by a moving plate, frame after frame."""

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
from palpate_edge.calibration.evaluation import Figures

COMMAND = "`palpate-edge evaluate press-sequences/finger-1 --calibration sample.cal`"
FAR_MM = 2.0


def section(found: Sequence[Figures]) -> Section:
    rows = []
    for figures in found:
        band = figures.overall
        rows.append(
            (
                figures.dataset,
                str(band.count),
                *(number(value, 3) for value in (band.mean_mm, band.median_mm, band.p95_mm, band.max_mm)),
                number(band.force_rmse_percent),
                number(band.direction_deg),
                number(band.covered_percent, 1),
                str(refused(figures)),
                f"{wrong_flags(figures)} of {figures.confusion.judged}",
                lighter_missed(figures),
            )
        )
    head = (
        "",
        "touches",
        "mean mm",
        "median",
        "p95",
        "max",
        "force %",
        "deg",
        "covered %",
        "refused",
        "flag wrong",
        "lighter missed",
    )
    text = paragraph(f"""
        Recordings of the same sensor that no calibration has seen: touching, pressing and leaving,
        {found[0].frames} frames each. "flag wrong" is of frames without touch or with one of the
        contact threshold in newtons or more, "lighter missed" of the lighter ones. {COMMAND}.
        """)
    light = "The lightest and the heaviest third of each: where the large errors are."
    by_force = table(("force, N", "touches", "mean mm", "max mm"), _by_force(found))
    parts = ["## Press sequences", text, table(head, rows), light, by_force]
    return Section("\n\n".join(parts), _shortcomings(found))


def coverage(found: Sequence[tuple[str, Figures]]) -> Section:
    """The share of contacts inside their 95 % radius, wherever a radius was given."""
    rows = [
        (name, str(figures.overall.count), number(figures.overall.covered_percent, 1))
        for name, figures in found
    ]
    bands = [figures.overall for _, figures in found]
    touches = sum(band.count for band in bands)
    pooled = sum(band.count * (band.covered_percent or 0.0) for band in bands) / touches
    rows.append(("all of these", str(touches), number(pooled, 1)))
    text = paragraph("""
        Share of contacts no farther from the given position than the radius given with it; the goal
        is 93 to 97 %. Frames of a sequence follow one another, so that they are fewer independent
        trials than it seems. The share under stress stands in the stress table. `palpate-edge
        evaluate` as above, column "in 95% radius".
        """)
    parts = ["## The 95 % radius", text, table(("", "touches", "covered %"), rows)]
    return Section("\n\n".join(parts), coverage_shortcoming("All of these together", pooled, touches))


def _by_force(found: Sequence[Figures]) -> list[tuple[str, ...]]:
    """Each sequence's lightest third beside its heaviest: where the large errors are."""
    rows: list[tuple[str, ...]] = []
    for figures in found:
        third_N = figures.largest_force_N / 3
        for band, low in ((figures.forces[0], 0.0), (figures.forces[2], 2 * third_N)):
            name = f"{figures.dataset}, {low:.2f} to {low + third_N:.2f}"
            rows.append((name, str(band.count), number(band.mean_mm, 3), number(band.max_mm, 3)))
    return rows


def _shortcomings(found: Sequence[Figures]) -> tuple[str, ...]:
    sentences = []
    for figures in found:
        worst, light = figures.overall.max_mm or 0.0, figures.forces[0].max_mm or 0.0
        if worst > FAR_MM:
            when = "while the touch is light" if light == worst else "under load"
            sentences.append(f"{figures.dataset}: single frames are up to {worst:.1f} mm off, {when}.")
        sentences += coverage_shortcoming(
            figures.dataset, figures.overall.covered_percent, figures.overall.count
        )
    return tuple(sentences)
