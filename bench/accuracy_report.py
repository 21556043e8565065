"""Pieces of docs/accuracy.md: sections, Markdown tables, and how figures are written."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.calibration.evaluation import Figures

PAGE_WIDTH = 110
COVERAGE_GOAL_PERCENT = (93.0, 97.0)


@dataclass(frozen=True, slots=True)
class Section:
    """A part of the report, and the sentences on what in it falls short."""

    text: str
    shortcomings: tuple[str, ...] = ()


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; all columns but the first are right-aligned."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    lines.insert(1, "|---|" + "---:|" * (len(head) - 1))
    return "\n".join(lines)


def paragraph(text: str) -> str:
    """Text as lines of the page's width."""
    return textwrap.fill(" ".join(text.split()), PAGE_WIDTH, break_long_words=False, break_on_hyphens=False)


def number(value: float | None, digits: int = 2) -> str:
    """A figure, or a dash where there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def wrong_flags(figures: Figures) -> int:
    """Frames in which the contact flag is wrong, but for touches below the calibration's threshold."""
    return figures.confusion.wrong


def lighter_missed(figures: Figures) -> str:
    """Touches below the calibration's threshold that were missed, and how many there were."""
    return f"{figures.confusion.missed_below} of {figures.confusion.touches_below}"


def refused(figures: Figures) -> int:
    return sum(figures.refused.values())


def coverage_shortcoming(what: str, percent: float | None, contacts: int) -> tuple[str, ...]:
    """A sentence when the 95 % radius holds more or fewer contacts than it should."""
    low, high = COVERAGE_GOAL_PERCENT
    if percent is None or low <= percent <= high:
        return ()
    kind = "too small" if percent < low else "larger than needed"
    return (f"{what}: the 95 % radius is {kind}, it holds {percent:.1f} % of {contacts} contacts.",)
