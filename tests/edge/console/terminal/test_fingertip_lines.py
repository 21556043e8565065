"""The screen of a fingertip, from events as its feed publishes them."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.terminal.lines import Palette, cells, plain_text
from palpate_edge.console.events import ConsoleHealth, ConsoleState
from palpate_edge.console.pictures import console_frame
from palpate_edge.console.terminal.fingertip_lines import fingertip_lines
from palpate_edge.console.terminal.fingertip_view import FingertipView
from palpate_edge.daemon.check_rows import CheckRow, Verdict
from palpate_edge.daemon.watching.watch_messages import BeadsShown, WatchedFingertip

TOUCH = Contact(7, 0, True, True, (0.0, 0.0, 30.0), 2.0, (0.3, 0.4, -2.0), 1.0, "", 84, 85, radius95_mm=6.0)
REFUSED = refused_contact(8, 0, "12 of 85 beads found", 12, 85)
ROWS = [
    CheckRow("camera", "30.0 frames/s", "", Verdict.OK, ""),
    CheckRow("beads", "70 of 85", "", Verdict.WARN, "clean the dome; " + 8 * "check light "),
    CheckRow("bus", "down", "", Verdict.FAIL, "check wiring"),
]


def view_at(now_s, contact=TOUCH):
    view = FingertipView("index")
    beads = BeadsShown([(10.0, 10.0)], [(10.0, 10.0)], [])
    events = {
        "state": ConsoleState(True, "live, from the daemon"),
        "fingertip": WatchedFingertip("index", "paper", 30.0, False, True, ""),
        "health": ConsoleHealth(
            fps=29.9, dropped=3, nmt_state="OPERATIONAL", recording="", light=None, rows=ROWS
        ),
        "frame": console_frame(np.full((240, 320), 128, np.uint8), contact, 8.25, beads),
        "guide": {"not": "shown"},
    }
    for kind, value in events.items():
        view.take((kind, msgspec.json.encode(value)), now_s)
    return view


def shown(view, now_s=100.0, columns=80, rows=24, palette=Palette.NONE):
    lines = fingertip_lines(view, now_s, columns, rows, palette)
    assert len(lines) == rows
    return ["".join(cell[0] for cell in cells(line, columns, palette)).rstrip() for line in lines]


def test_a_small_terminal_has_all_of_it():
    text = shown(view_at(100.0))
    assert text[0].startswith("index  live, from the daemon")
    joined = "\n".join(text)
    for value in (
        "0.0, 0.0, 30.0 mm",
        "6.00 mm",
        "2.00 N",
        "0.50 N",
        "84 of 85",
        "29.9 frames/s, 3 dropped",
        "8.2 ms",
    ):
        assert value in joined
    assert text[14].startswith("    2 N") and text[14].rstrip().endswith("#")  # the force, just now
    assert [line.rstrip() for line in text[-6:-2]] == [
        "fail    bus: down",
        "        -> check wiring",
        "warn    beads: 70 of 85",
        "        -> clean the dome; check light check light check light check light check",
    ]
    assert "q quit" in text[-1]


@pytest.mark.parametrize(("columns", "rows"), [(140, 40), (140, 28)])  # below the figures, beside them
def test_a_larger_terminal_has_the_dome_with_the_contact_at_its_apex(columns, rows):
    text = shown(view_at(100.0), columns=columns, rows=rows)
    dome = [line for line in text if "@" in line]
    assert len(dome) == 1 and dome[0].count("@") == 1
    left = dome[0].index("@")
    assert dome[0][left - 3 : left] == "+++"  # 6 mm of 60 mm in 32 columns: 3.2 columns
    assert "@" not in "".join(shown(view_at(100.0, REFUSED), columns=columns, rows=rows))


def test_a_refused_frame_has_its_reason_and_no_force():
    text = shown(view_at(100.0, REFUSED))
    assert any("12 of 85 beads found" in line for line in text)
    assert text[14].strip() == "1 N"


@pytest.mark.parametrize("palette", Palette)
@pytest.mark.parametrize("size", [(60, 16), (80, 24), (81, 17), (132, 43), (300, 20), (60, 100)])
def test_every_size_is_filled_exactly(size, palette):
    for view in (FingertipView("index"), view_at(100.0)):
        lines = fingertip_lines(view, 100.0, *size, palette)
        assert len(lines) == size[1]
        assert all(len(plain_text(line)) <= size[0] for line in lines)


def test_old_pictures_and_small_screens_are_marked():
    assert "no picture for 2.5 s" in shown(view_at(100.0), 102.5)[0]
    assert "no picture" not in shown(view_at(100.0), 100.5)[0]
    (line,) = fingertip_lines(view_at(100.0), 100.0, 20, 5, Palette.NONE)
    assert "too small" in plain_text(line)
