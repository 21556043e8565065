"""The figures of an evaluation as a table for people."""

from __future__ import annotations

from palpate_edge.calibration.evaluation import Band, Confusion, Figures
from palpate_edge.calibration.quantity_figures import quantity_lines


def as_table(figures: Figures) -> str:
    """The figures for people."""
    largest_N = figures.largest_force_N
    head = f"{figures.dataset}, split {figures.split}, method {figures.method}: {figures.frames} frames, " + (
        "force unknown" if largest_N is None else f"largest force {largest_N:.2f} N"
    )
    columns = "band", "n", "mean", "median", "p95", "max mm", "force N", "%", "deg", "in 95% radius"
    rows = [columns, *(_row(band) for band in (*figures.regions, *figures.forces, figures.overall))]
    width = [max(len(row[column]) for row in rows) for column in range(len(columns))]
    lines = [
        "  ".join(
            cell.ljust(w) if not place else cell.rjust(w)
            for place, (cell, w) in enumerate(zip(row, width, strict=True))
        )
        for row in rows
    ]
    tail = [
        *quantity_lines(figures.torsion, figures.force_covered_percent, figures.weighed),
        *_flag_lines(figures.confusion),
        f"refused: {sum(figures.refused.values())} of {figures.frames}"
        + "".join(f"; {count} x {reason}" for reason, count in figures.refused.items()),
        *(
            f"{time.stage}: {time.median_ms:.2f} ms median, {time.p99_ms:.2f} ms p99"
            for time in figures.times
        ),
    ]
    return "\n".join([head, *lines, *tail])


def _flag_lines(confusion: Confusion) -> list[str]:
    """Wrong contact flags: of touches from the threshold on, and apart from them of lighter ones."""
    missed = confusion.touch_as_none - confusion.missed_below
    threshold_N = confusion.threshold_N
    where = "contact threshold unknown" if threshold_N is None else f"contact threshold {threshold_N:.3f} N"
    heaviest_N = confusion.heaviest_missed_N
    heaviest = f", none above {heaviest_N:.3f} N" if heaviest_N is not None and missed else ""
    lines = [
        f"{where}: contact flag wrong in {confusion.wrong} of {confusion.judged} frames "
        f"({100 * confusion.wrong / max(1, confusion.judged):.2f} %): "
        f"{missed} touches missed{heaviest}, {confusion.none_as_touch} false",
    ]
    if confusion.touches_below:
        lines.append(f"touches below it missed: {confusion.missed_below} of {confusion.touches_below}")
    return lines


def _row(band: Band) -> tuple[str, ...]:
    values = (band.mean_mm, band.median_mm, band.p95_mm, band.max_mm, band.force_rmse_N)
    percent = (band.force_rmse_percent, band.direction_deg, band.covered_percent)
    return (
        band.name,
        str(band.count),
        *("-" if value is None else f"{value:.3f}" for value in values),
        *("-" if value is None else f"{value:.2f}" for value in percent),
    )
