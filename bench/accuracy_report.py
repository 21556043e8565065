"""Parts of docs/accuracy.md: sections, Markdown tables and number formats."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.calibration.evaluation import Figures

PAGE_WIDTH = 110
COVERAGE_GOAL_PERCENT = (93.0, 97.0)


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the report, and its entries in the list of limitations."""

    text: str
    shortcomings: tuple[str, ...] = ()


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; all columns except the first are right-aligned."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    lines.insert(1, "|---|" + "---:|" * (len(head) - 1))
    return "\n".join(lines)


def paragraph(text: str) -> str:
    """Return the text in lines of the page's width."""
    return textwrap.fill(" ".join(text.split()), PAGE_WIDTH, break_long_words=False, break_on_hyphens=False)


def number(value: float | None, digits: int = 2) -> str:
    """Return a figure as text, or a dash if there is none."""
    return "-" if value is None else f"{value:.{digits}f}"


def wrong_flags(figures: Figures) -> int:
    """Return the number of wrong contact flags, without contacts below the calibration's threshold."""
    return figures.confusion.wrong


def lighter_missed(figures: Figures) -> str:
    """Return the numbers of missed and of all contacts below the calibration's threshold."""
    return f"{figures.confusion.missed_below} of {figures.confusion.touches_below}"


def rejected(figures: Figures) -> int:
    """Return the number of rejected frames."""
    return sum(figures.refused.values())


def coverage_shortcoming(what: str, percent: float | None, contacts: int) -> tuple[str, ...]:
    """Return a sentence if the 95 % radius contains more or fewer contacts than its goal."""
    low, high = COVERAGE_GOAL_PERCENT
    if percent is None or low <= percent <= high:
        return ()
    kind = "too small" if percent < low else "larger than necessary"
    return (f"{what}: the 95 % radius is {kind}: it contains {percent:.1f} % of {contacts} contacts.",)
