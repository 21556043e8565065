"""docs/building.md: its figures are those of docs/accuracy.md, and its first contact works as written."""

from __future__ import annotations

import math
import re
import shutil
import sys
from pathlib import Path

import pytest
from tests.first_contact import OUTER_RADIUS_MM, commands, contacts, walk

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ROW = re.compile(r"^\| ([^|]+) \| (\d\.\d\d) \|", re.MULTILINE)


def test_figures_are_those_of_the_accuracy_page() -> None:
    told = ROW.findall((DOCS / "building.md").read_text())
    measured = ROW.findall((DOCS / "accuracy.md").read_text())
    assert len(told) == 11
    assert [row for row in told if row not in measured] == []


def test_first_contact_takes_ten_commands_at_most() -> None:
    assert 0 < len(commands()) <= 10


@pytest.mark.slow
def test_first_contact_works_as_written(tmp_path: Path) -> None:
    """From an empty folder with a recorded camera to a contact of the recording's presses on the screen."""
    folder = tmp_path / "empty"
    folder.mkdir()
    shutil.copy(ROOT / "demo" / "recording" / "finger-1" / "frames.webm", folder / "dome.webm")
    places = contacts(screen := walk(folder, Path(sys.executable).parent, limit_s=600))
    touched = [place for place in places if any(place)]
    assert len(touched) > 10, screen
    assert len(touched) < len(places)
    assert all(math.hypot(*place) == pytest.approx(OUTER_RADIUS_MM, abs=0.1) for place in touched)
