"""Figures of docs/building.md are those of docs/accuracy.md, which its own command writes."""

from __future__ import annotations

import re
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
ROW = re.compile(r"^\| ([^|]+) \| (\d\.\d\d) \|", re.MULTILINE)


def test_figures_are_those_of_the_accuracy_page() -> None:
    told = ROW.findall((DOCS / "building.md").read_text())
    measured = ROW.findall((DOCS / "accuracy.md").read_text())
    assert len(told) == 11
    assert [row for row in told if row not in measured] == []
