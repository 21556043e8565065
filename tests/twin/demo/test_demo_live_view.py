"""The live view as text, at the supported window sizes."""

from __future__ import annotations

from dataclasses import replace
from io import StringIO

import pytest
from rich.console import Console

from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, FingerStatus, HostStatus, JointStatus
from palpate_twin.demo.dome_map import CONTACT_DOT, dome_map
from palpate_twin.demo.live_view import ViewScale, plain_line, render
from palpate_twin.demo.monitor import MonitorSample

FREE = FingerStatus(
    name="finger-1",
    position_mm=None,
    normal_force_N=None,
    shear_N=None,
    torsion_Nmm=None,
    valid=True,
    in_contact=False,
    slip=False,
    quality=255,
    sequence=7,
    age_ms=12.0,
    latency_us=900,
    frames_per_s=30.0,
    complete=8,
    incomplete=0,
    out_of_order=0,
    duplicates=0,
    late=0,
    lost_frames=0,
    unpaired=0,
)
TOUCHED = replace(
    FREE, name="finger-2", in_contact=True, position_mm=(-12.34, 5.0, 26.9), normal_force_N=1.25, quality=128
)
REFUSED = replace(FREE, name="finger-3", valid=False, quality=0)
TORQUES_NM = (0.5, -0.25, 0.0)


def joints(finger):
    names = ("abduction", "flexion", "curl")
    return [
        JointStatus(f"{name}_{finger}", 0.1, 0.0, torque, torque, "operation enabled")
        for name, torque in zip(names, TORQUES_NM, strict=True)
    ]


STATUS = HostStatus(
    time_us=1_700_000_000_000_000,
    mode=Mode.BLIND,
    reason="finger-1: no contact",
    warning="",
    fingers=(FREE, TOUCHED, REFUSED),
    joints=tuple(joint for finger in (1, 2, 3) for joint in joints(finger)),
    R_vir=None,
    R_c=None,
    R_d=None,
    R_d_vir=None,
    orientation_error_deg=3.14159,
    fit_residual_deg=0.0,
    target_rpy_deg=(0.0, 0.0, 10.0),
    last_emergency="",
    counters=Counters(),
)
SAMPLE = MonitorSample(STATUS, (None, 15_432.0, 15_000.0), 0.2345)
SCALE = ViewScale(
    duration_s=20.0, bitrate=1_000_000, dome_radius_mm=30.0, force_N=2.5, torque_limit_Nm=(0.5,) * 9
)


def draw(sample, width, height):
    console = Console(width=width, height=height, record=True, force_terminal=True, file=StringIO())
    console.print(render(sample, SCALE, 4.2), height=height, end="")
    return console.export_text()


@pytest.mark.parametrize(("width", "height"), [(100, 30), (80, 24), (160, 50)])
def test_everything_is_there_and_fits(width, height):
    text = draw(SAMPLE, width, height)
    lines = text.splitlines()
    assert len(lines) == height
    assert {len(line) for line in lines} == {width}
    for shown in (
        "BLIND",
        "finger-1: no contact",
        "finger-1: free",
        "finger-2: contact",
        "finger-3: rejected",
        "-12.3 +5.0 +26.9 mm",
        "1.25 N",
        "30 fps, latency 15.4 ms",
        "quality 50%, age 12 ms",
        "bus load 23.4% of 1000 kbit/s",
        "3.14 deg",
        "limit 0.5 N m",
        "+0.50",
        "-0.25",
    ):
        assert shown in text, shown
    assert text.count(CONTACT_DOT) == 1


def test_a_torque_at_its_limit_fills_its_half_of_the_bar():
    rows = [line for line in draw(SAMPLE, 100, 30).splitlines() if "+0.50" in line]
    bar = rows[0].partition("[")[2].partition("]")[0]
    left, _, right = bar.partition("│")
    assert left.strip() == ""
    assert set(right) == {"━"}


def test_a_negative_torque_goes_to_the_left_by_its_share():
    rows = [line for line in draw(SAMPLE, 160, 50).splitlines() if "-0.25" in line]
    left, _, right = rows[0].partition("[")[2].partition("]")[0].partition("│")
    assert right.strip() == ""
    assert left.count("━") + 0.5 * left.count("╺") == pytest.approx(len(left) / 2, abs=0.5)


def test_before_the_first_status_and_in_a_tiny_window():
    nothing = MonitorSample(None, (None, None, None), None)
    assert "waiting for the host" in draw(nothing, 80, 24)
    assert "starting" in plain_line(nothing, 0.0)
    draw(SAMPLE, 40, 10)


def test_the_law_with_contacts_is_called_as_in_the_paper():
    sample = replace(SAMPLE, status=replace(STATUS, mode=Mode.MANIPULATE, reason="every finger in contact"))
    assert "PROPOSED" in draw(sample, 80, 24)


def test_plain_line_is_one_line_with_every_finger():
    line = plain_line(SAMPLE, 4.2)
    assert "\n" not in line
    for shown in (
        "4.2 s",
        "BLIND",
        "finger-1 0.00 N, 30 fps |",
        "finger-2 1.25 N, 30 fps, 15.4 ms |",
        "finger-3 rejected",
        "bus load 23.4%",
    ):
        assert shown in line


def test_values_that_lock_step_does_not_measure_are_left_out_of_the_line():
    line = plain_line(MonitorSample(STATUS, (None, None, None), None), 4.2)
    assert "bus load" not in line
    assert " ms" not in line.partition("|")[2]


@pytest.mark.parametrize(
    ("position_mm", "right", "up"),
    [
        ((20.0, 0.0, 22.0), 1, 0),
        ((-20.0, 0.0, 22.0), -1, 0),
        ((0.0, 20.0, 22.0), 0, 1),
        ((0.0, -20.0, 22.0), 0, -1),
    ],
)
def test_the_dot_is_where_the_contact_is(position_mm, right, up):
    lines = dome_map(40, 20, 30.0, position_mm).plain.splitlines()
    row = next(number for number, line in enumerate(lines) if CONTACT_DOT in line)
    column = lines[row].index(CONTACT_DOT)
    # 20 of 30 mm is 2/3 of the way to the rim: 13 of 20 columns, 6.7 of 10 rows from the middle
    assert column == pytest.approx(20 + right * 13.3, abs=1)
    assert row == pytest.approx(10 - up * 6.7, abs=1)


def test_a_contact_beyond_the_rim_stays_on_the_map():
    assert CONTACT_DOT in dome_map(20, 10, 30.0, (99.0, -99.0, 0.0)).plain
