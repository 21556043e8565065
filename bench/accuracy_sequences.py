"""Errors on the press sequences: recordings of the sample's sensor under a moving plate."""

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
                str(rejected(figures)),
                f"{wrong_flags(figures)} of {figures.confusion.judged}",
                lighter_missed(figures),
            )
        )
    head = (
        "",
        "contacts",
        "mean mm",
        "median",
        "p95",
        "max",
        "force %",
        "deg",
        "covered %",
        "rejected",
        "wrong flags",
        "lighter missed",
    )
    text = paragraph(f"""
        Recordings of the same sensor that were not used for calibration: a plate touches, presses and
        leaves, {found[0].frames} frames each. "wrong flags" counts frames without contact or with a
        force of at least the contact threshold, "lighter missed" contacts below it. Command: {COMMAND}.
        """)
    light = "Large errors occur in the lightest third of each sequence. For comparison, the heaviest third:"
    by_force = table(("force, N", "contacts", "mean mm", "max mm"), _by_force(found))
    parts = ["## Press sequences", text, table(head, rows), light, by_force]
    return Section("\n\n".join(parts), _shortcomings(found))


def coverage(found: Sequence[tuple[str, Figures]]) -> Section:
    """Return the section on the share of contacts within their 95 % radius."""
    rows = [
        (name, str(figures.overall.count), number(figures.overall.covered_percent, 1))
        for name, figures in found
    ]
    bands = [figures.overall for _, figures in found]
    contacts = sum(band.count for band in bands)
    pooled = sum(band.count * (band.covered_percent or 0.0) for band in bands) / contacts
    rows.append(("all of these", str(contacts), number(pooled, 1)))
    text = paragraph("""
        Share of contacts whose true position is within the estimated radius of the estimated position;
        the goal is 93 to 97 %. Successive frames of a sequence are not independent, so the number of
        independent trials is smaller than the number of contacts. The shares under stress are in the
        stress table. Command: `palpate-edge evaluate` as above, column "in 95% radius".
        """)
    parts = ["## The 95 % radius", text, table(("", "contacts", "covered %"), rows)]
    return Section("\n\n".join(parts), coverage_shortcoming("All of these together", pooled, contacts))


def _by_force(found: Sequence[Figures]) -> list[tuple[str, ...]]:
    """Return the rows of each sequence's lightest and heaviest third."""
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
            when = "at light contact" if light == worst else "under load"
            sentences.append(f"{figures.dataset}: errors of single frames are up to {worst:.1f} mm {when}.")
        sentences += coverage_shortcoming(
            figures.dataset, figures.overall.covered_percent, figures.overall.count
        )
    return tuple(sentences)
