"""docs/building.md: its figures are those of docs/accuracy.md, and its first contact works as written."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ROW = re.compile(r"^\| ([^|]+) \| (\d\.\d\d) \|", re.MULTILINE)
CONTACT = re.compile(
    r"contact x (-?[\d.]+) mm, Value of contact y (-?[\d.]+) mm, Value of contact z (-?[\d.]+) mm"
)
OUTER_RADIUS_MM = 30.0
END = """
kill $(jobs -p)
wait
"""


def test_figures_are_those_of_the_accuracy_page() -> None:
    told = ROW.findall((DOCS / "building.md").read_text())
    measured = ROW.findall((DOCS / "accuracy.md").read_text())
    assert len(told) == 11
    assert [row for row in told if row not in measured] == []


@pytest.mark.long
def test_first_contact_works_as_written(tmp_path: Path) -> None:
    """From an empty folder with a recorded camera to a contact of the recording's presses on the screen."""
    page = (DOCS / "building.md").read_text().split("## First contact")[1]
    lines = page.split("```sh\n")[1].split("```")[0].splitlines()
    assert len(lines) <= 10
    assert all(line.startswith(("palpate-edge ", "palpate-host ")) for line in lines)
    folder = tmp_path / "empty"
    folder.mkdir()
    shutil.copy(ROOT / "demo" / "recording" / "finger-1" / "frames.webm", folder / "dome.webm")
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        "XDG_RUNTIME_DIR": str(tmp_path),
        "PALPATE_HUB": str(tmp_path / "hub.sock"),
    }
    done = subprocess.run(
        ["bash", "-e", "-c", "\n".join([*lines, END])],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode in (0, 143), done.stdout + done.stderr
    places = [[float(value) for value in found] for found in CONTACT.findall(done.stdout)]
    touched = [place for place in places if any(place)]
    assert len(touched) > 10, done.stdout + done.stderr
    assert len(touched) < len(places)
    assert all(math.hypot(*place) == pytest.approx(OUTER_RADIUS_MM, abs=0.1) for place in touched)
