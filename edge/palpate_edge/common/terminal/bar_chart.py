"""Bars of a quantity over time, as lines of a terminal. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from palpate_edge.common.terminal.lines import ORANGE, Line, Palette, Span, text_line

EIGHTHS = " ▁▂▃▄▅▆▇█"
LABEL_COLUMNS = 8

Sample = tuple[float, float | None]
"""A time in s and a value; None: unknown."""


def binned(samples: Iterable[Sample], now_s: float, span_s: float, columns: int) -> list[float | None]:
    """Return the largest value in each of `columns` equal parts of the last `span_s`, oldest first."""
    bins: list[float | None] = [None] * columns
    for at_s, value in samples:
        place = columns - 1 - math.floor((now_s - at_s) * columns / span_s)
        if value is not None and 0 <= place < columns:
            former = bins[place]
            bins[place] = value if former is None else max(former, value)
    return bins


def bar_chart(values: Sequence[float | None], rows: int, unit: str, palette: Palette) -> list[Line]:
    """Return bars of `rows` lines from 0 to the scale at the left: 1, 2 or 5 times a power of ten.

    The bottom row of a bar is never empty, so that 0 and unknown differ.
    """
    scale = round_scale(max((value for value in values if value is not None), default=0.0))
    lines = []
    for row in range(rows - 1, -1, -1):
        text = "".join(_cell(value, scale, row, rows, palette) for value in values)
        label = f"{scale:g} {unit}" if row == rows - 1 else ""
        lines.append([Span(f"{label:>{LABEL_COLUMNS - 1}} "), Span(text, ORANGE)])
    return lines


def level_bar(value: float | None, full: float, columns: int) -> Line:
    """Return a bar of `columns` cells from 0 to `full`; empty for an unknown value."""
    share = 0.0 if value is None else min(1.0, max(0.0, value / full))
    filled = round(share * columns)
    return [*text_line("█" * filled, ORANGE), Span("·" * (columns - filled))]


def round_scale(most: float) -> float:
    """Return the least of 1, 2, 5, 10, 20 ... that is not below `most`."""
    if most <= 1:
        return 1.0
    decade = 10.0 ** math.floor(math.log10(most))
    return next(step * decade for step in (1, 2, 5, 10) if most <= step * decade)


def _cell(value: float | None, scale: float, row: int, rows: int, palette: Palette) -> str:
    if value is None:
        return " "
    eighths = round(8 * (max(0.0, value) / scale * rows - row))
    eighths = min(8, max(0, eighths, 1 if row == 0 else 0))
    if palette is Palette.NONE:
        return "#" if eighths >= 4 else "_" if row == 0 else " "
    return EIGHTHS[eighths]
