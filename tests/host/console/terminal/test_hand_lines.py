"""The screen of a hand, from a host's status."""

from __future__ import annotations

import math

import pytest

from palpate_edge.common.terminal.lines import RED, Palette, cells, plain_text
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, FingerStatus, HostStatus, JointStatus
from palpate_host.console.terminal.hand_lines import hand_lines

NO_COUNTS = dict.fromkeys(
    ("complete", "incomplete", "out_of_order", "duplicates", "late", "lost_frames", "unpaired"), 0
)


def finger(name, force_N, *, valid=True, slip=False):
    return FingerStatus(
        name, None, force_N, None, valid, force_N is not None, slip, 255, 1, 12.0, 2000, 29.6, **NO_COUNTS
    )


def status(mode=Mode.MANIPULATE):
    return HostStatus(
        time_us=0,
        mode=mode,
        reason="all fingers touch",
        warning="joint near its end",
        fingers=(finger("thumb", 1.0), finger("index", 2.0, slip=True), finger("middle", None, valid=False)),
        joints=tuple(
            JointStatus(f"j{number}", math.pi / 4, 0.0, 0.02, -0.05, "operation enabled")
            for number in range(9)
        ),
        R_vir=None,
        R_c=None,
        R_d=None,
        R_d_vir=None,
        orientation_error_deg=1.234,
        fit_residual_deg=None,
        target_rpy_deg=(0.0, 0.0, 30.0),
        last_emergency="",
        counters=Counters(),
        turned=0.4,
    )


def lines_of(value, connection="", question="", columns=80, rows=24):
    return hand_lines(value, connection, "grasp: accepted", question, columns, rows, Palette.NONE)


def shown(*arguments, columns=80, **options):
    lines = lines_of(*arguments, columns=columns, **options)
    return ["".join(cell[0] for cell in cells(line, columns, Palette.NONE)).rstrip() for line in lines]


def test_a_small_terminal_has_fingers_mode_and_joints():
    text = shown(status())
    assert text[0] == "manipulate  all fingers touch"
    assert text[1] == "joint near its end"
    assert text[2] == "target      0, 0, 30 deg  done 40 %  orientation error 1.23 deg"
    assert text[4].split() == ["thumb", "yes", "1.00", "N", "######......", "12", "ms", "30", "/s"]
    assert text[5].split()[1:4] == ["slips", "2.00", "N"] and "############" in text[5]
    assert text[6].split()[:3] == ["middle", "invalid", "-"]
    assert " ".join(text[8].split()) == "j0 45.0 deg -0.050 Nm ######...... 0.020 Nm operation enabled"
    assert text[16].startswith("j8")
    assert text[22] == "grasp: accepted"
    assert text[23].startswith("SPACE stop")


@pytest.mark.parametrize("rows", [16, 24, 50])
def test_the_stop_key_is_always_on_the_last_line(rows):
    for text in (shown(status(), rows=rows), shown(status(), question="grasp", rows=rows)):
        assert len(text) == rows and "SPACE stop" in text[-1]
    assert shown(None, "no hand is running", rows=rows)[0] == "no hand is running"


def test_a_screen_too_small_has_the_stop_key():
    assert "SPACE stop" in plain_text(lines_of(status(), columns=30, rows=10)[0])


@pytest.mark.parametrize("mode", [Mode.FAULT, Mode.STOP])
def test_a_stopped_hand_is_red(mode):
    assert lines_of(status(mode))[0][0].colour == RED
