"""The report of a run whose figures are given: cells of its tables, embedded pictures, lines of text."""

from __future__ import annotations

import base64
import html
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from palpate_host.common.mode import Mode
from palpate_host.common.tip_contact import TipContact
from palpate_twin.demo import plots
from palpate_twin.demo.analysis import Analysis, Summary, summary_lines, write_summary
from palpate_twin.demo.distribution import Distribution
from palpate_twin.demo.film import Film
from palpate_twin.demo.hand_motion import HandFigures, HostTick, JointFigures, JointTorque, TimedMode
from palpate_twin.demo.report import write_report
from palpate_twin.demo.run_folder import make_run_folder
from palpate_twin.demo.traffic import IdLoad, Traffic
from palpate_twin.demo.truth import FingerFigures, Pair, TrueContact
from palpate_twin.demo.turn import TurnFigures, TurnSeries, TurnStep
from palpate_twin.hand.push_recovery import PushStep

pytestmark = pytest.mark.long

BEGIN_US = 1_700_000_000_000_000
STEPS = (
    TurnStep((30.0, 0.0, 0.0), 1.0, 5.0, 0.41, 0.12, (0.0, 0.1, 0.02), 0.38, 1.0),
    TurnStep((-30.0, 0.0, 0.0), 5.0, 9.0, 21.0, 0.22, (0.0, 0.1, 0.02), 0.39, 0.96),
)
LATENCY_US = Distribution(90, 21_000.0, 20_500.0, 24_000.0, 26_500.0, 31_000.0)


def contact(sequence: int, position_mm=(1.0, 2.0, 29.0), **changed) -> TipContact:
    known = {
        "received_at_us": BEGIN_US + 33_333 * sequence + 20_000,
        "exposed_at_us": BEGIN_US + 33_333 * sequence,
        "sequence": sequence,
        "latency_us": 20_000,
        "position_mm": position_mm,
        "normal_force_N": 1.5,
        "shear_N": (0.0, 0.0),
        "torsion_Nmm": 0.0,
        "valid": True,
        "in_contact": position_mm is not None,
        "slip": False,
        "quality": 255,
    }
    return TipContact(**{**known, **changed})


def pairs(hidden: int) -> list[Pair]:
    """30 frames; one without contact."""
    truth = TrueContact((1.1, 2.0, 29.0), 1.6)
    found = [Pair(number, contact(number), truth) for number in range(30)]
    found[hidden] = Pair(hidden, contact(hidden, None), TrueContact(None, 0.0))
    return found


def figures(name: str, **changed) -> FingerFigures:
    error = Distribution(29, 0.123, 0.111, 0.344, 0.4, 0.5)
    return replace(FingerFigures(name, 30, 2, 1, 0, 97.8, error, 0.0456, 2.34, LATENCY_US), **changed)


def analysis(config, *, recording: Path | None = None, turn: bool = True) -> Analysis:
    """A run of 10 s: three fingers, of which the last one gave no contact."""
    names = [finger.name for finger in config.fingers]
    joints = [joint.name for joint in config.joints]
    fingers = (
        *(figures(name) for name in names[:-1]),
        figures(
            names[-1],
            position_error_mm=None,
            force_rmse_N=None,
            force_rmse_percent=None,
            contact_right_percent=None,
            latency_us=None,
        ),
    )
    ids = (IdLoad(0x080, "SYNC", 1000, 100.0, 0.8), IdLoad(0x190, "TPDO 1 of finger-1", 300, 30.0, 1.234))
    changes = tuple(TimedMode(0.1 * n, Mode.GRASP, f"reason {n}") for n in range(45))
    hand = HandFigures(
        {"ready": 1.25, "manipulate": 6.5},
        changes,
        Distribution(500, 0.6, 0.5, 1.5, 2.0, 2.5),
        tuple(JointFigures(name, 0.3, 0.21, 900, 2 if name == joints[0] else 0) for name in joints),
    )
    summary = Summary(
        started_at="2026-01-01T00:00:00",
        duration_s=10.0,
        bitrate=1_000_000,
        origin={"origin": "palpate demo", "eds.fingertip": "ab12", "node.16": "finger-1"},
        fingers=fingers,
        bus=Traffic(1300, 130_000, 10.0, 2.034, 3.5, tuple(2.0 + 0.01 * n for n in range(100)), ids),
        hand=hand,
        turn=TurnFigures(STEPS, 3.21, 0.98, 0.4, 0.97) if turn else None,
        pushes=(
            PushStep((0.0, 0.0, -2.0), 7.6, 0.2, 7.2, 0.1),
            PushStep((2.0, 0.0, 0.0), 8.6, 0.2, 40.0, 30.0),
        ),
    )
    times_s = np.linspace(0.0, 10.0, 50)
    degrees = np.column_stack((3.0 * times_s, 0.0 * times_s, 0.0 * times_s))
    series = TurnSeries(times_s, degrees, degrees + 0.1, degrees - 0.1, np.full(50, 0.2))
    modes = (Mode.READY, Mode.GRASP, Mode.MANIPULATE, Mode.GRASP)
    ticks = [
        HostTick(BEGIN_US + 10_000 * n, modes[min(n // 10, 3)], "", 0.5 if n > 20 else None)
        for n in range(50)
    ]
    stamps = BEGIN_US + 10_000.0 * np.arange(50)
    torques = [JointTorque(name, 0.3, stamps, 0.1 * np.sin(0.1 * np.arange(50))) for name in joints]
    return Analysis(
        *(summary, BEGIN_US, config, recording, tuple(pairs(n) for n in range(len(names))), ticks, torques),
        None,
        series if turn else None,
    )


def rows(page: str) -> list[list[str]]:
    lines = re.findall(r"<tr>(.*?)</tr>", page)
    return [[html.unescape(cell) for cell in re.findall(r"<td>(.*?)</td>", line)] for line in lines]


def pictures(page: str) -> dict[str, np.ndarray]:
    """Alternative text -> decoded picture."""
    found = re.findall(r'<img alt="(.*?)" src="data:image/\w+;base64,(.*?)">', page)
    return {
        html.unescape(name): cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), 1)
        for name, data in found
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_run_folder(tmp_path_factory.mktemp("demo") / "run", None, 1_000_000)


@pytest.fixture(scope="module")
def page(folder, hand_config) -> str:
    path = folder.path.parent / "report.html"
    film = np.full((20, 30, 3), 90, np.uint8)
    for suffix in (".webp", ".png"):
        assert cv2.imwrite(str(folder.film.with_suffix(suffix)), film)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plots, "DPI", 40)  # small pictures are drawn sooner
        write_report(path, analysis(hand_config), folder, lambda: Film(True, "drawn by a test"))
    return path.read_text()


def test_the_page_is_whole_without_network_and_scripts(page):
    assert page.startswith("<!doctype html>") and page.endswith("</html>\n")
    assert "<script" not in page
    assert not re.findall(r"(?:src|href)=\"(?!data:)", page)
    assert '<p class="verdict bad">Not as it should be: ' in page


def test_the_turns_and_pushes_have_their_figures(page):
    table = rows(page)
    assert [
        "roll +30 deg",
        "1.0 to 5.0",
        "0.41",
        "0.12",
        "0.00, 0.10, 0.02",
        "0.38",
        "1.00",
        "ok",
    ] in table
    second = next(row for row in table if row and row[1:3] == ["5.0 to 9.0", "21.00"])
    assert second[-1].lower() == "missed"
    assert ["push 2 N along -z for 0.2 s", "7.6", "7.2", "0.1", "ok"] in table
    assert ["push 2 N along +x for 0.2 s", "8.6", "40.0", "30.0", "NOT HELD"] in table
    assert "0.98 to 3.21 N" in page and "0.4 mm below" in page


def test_each_finger_has_its_errors_or_a_dash(page, hand_config):
    first, *_, last = [finger.name for finger in hand_config.fingers]
    table = rows(page)
    errors = ["0.12", "0.11", "0.34", "0.046", "2.3", "97.8"]
    assert [first, *errors, "30", "2", "1", "0"] in table
    assert [last, *["-"] * 6, "30", "2", "1", "0"] in table
    assert [first, "20.50", "21.00", "24.00", "26.50", "31.00"] in table
    assert sum(row[:1] == [last] for row in table) == 1  # no latency


def test_hand_and_bus_have_their_tables(page, hand_config):
    table = rows(page)
    joints = [joint.name for joint in hand_config.joints]
    assert [joints[0], "0.300", "0.210", "900", "2"] in table
    assert [joints[1], "0.300", "0.210", "900", "0"] in table
    assert "median 0.50 deg, p95 1.50, largest 2.50" in page
    assert sum(row[-1].startswith("reason ") for row in table if row) == 40
    assert "5 more changes are in summary.json" in page
    loads = [row for row in table if len(row) == 5 and row[0] in ("080", "190", "all")]
    assert loads == [
        ["190", "TPDO 1 of finger-1", "300", "30.0", "1.234"],
        ["080", "SYNC", "1000", "100.0", "0.800"],
        ["all", "", "1300", "130.0", "2.034"],
    ]
    assert ["eds.fingertip", "ab12"] in table and ["bit rate", "1000000 bit/s"] in table
    assert not any(row[:1] == ["node.16"] for row in table)


def test_the_pictures_are_in_the_page(page, hand_config):
    found = pictures(page)
    names = [finger.name for finger in hand_config.fingers]
    expected = ["the hand turning the object", "the hand at six times", "orientation", *names]
    assert list(found) == [*expected, "latency", "modes, orientation error and torques", "bus load"]
    assert found["orientation"].shape[:2] == (248, 400)
    for name in (*names, "latency", "bus load"):
        assert found[name].std() > 5.0  # lines on white


def test_the_commands_start_every_process_and_replay_the_log(page, folder, hand_config):
    block = html.unescape("".join(re.findall(r"<pre>(.*?)</pre>", page, re.DOTALL)))
    for finger in hand_config.fingers:
        assert f"{finger.name}.toml" in block
    assert f"palpate-host replay {folder.log} --config {folder.hand_toml}" in block
    assert f"palpate-host demo --report-only --output {folder.path.parent}" in block


def test_a_run_of_a_recording_has_no_object(folder, hand_config, tmp_path, monkeypatch):
    for name in ("contact_plot", "latency_plot", "hand_plot", "load_plot"):
        monkeypatch.setattr(plots, name, lambda *_: b"")
    played = analysis(hand_config, recording=Path("/recorded/fingers"), turn=False)
    hand = replace(played.summary.hand, orientation_error_deg=None)
    played = replace(played, summary=replace(played.summary, hand=hand, pushes=()))
    write_report(tmp_path / "report.html", played, folder, None)
    page = (tmp_path / "report.html").read_text()
    assert "<h2>The object</h2>" not in page
    assert "row (n modulo length) of the recording" in page and "/recorded/fingers/press" in page
    assert "never turned the object with contacts" in page


def test_the_lines_of_text_and_the_summary(hand_config, tmp_path):
    summary = analysis(hand_config).summary
    lines = summary_lines(summary)
    assert lines[0].split(": ", 1)[1].split("; ") == [
        "30 frames, 2 dropped, 1 rejected",
        "contact flag correct in 97.8 %",
        "position error 0.12 mm mean, 0.34 mm p95",
        "force RMSE 0.046 N (2.3 % of the largest force)",
        "exposure to bus 20.5 ms median, 26.5 ms p99",
    ]
    assert lines[len(summary.fingers) - 1].endswith(": 30 frames, 2 dropped, 1 rejected")
    assert "simulation speed: 0.97 of real time" in lines
    assert lines[-3] == "bus load: 2.0 % mean, 3.5 % peak"
    assert lines[-2] == "modes: READY 1.2 s, PROPOSED 6.5 s"
    assert lines[-1] == "torque commands above the limit: 2"
    write_summary(tmp_path / "summary.json", summary)
    assert '"smallest_N": 0.98' in (tmp_path / "summary.json").read_text()


def test_a_slow_simulation_names_the_way_out(hand_config):
    summary = analysis(hand_config).summary
    slow = replace(summary, turn=replace(summary.turn, pace=0.82))
    speeds = [
        line for line in summary_lines(slow) if line.startswith("simulation speed: 0.82 of real time: ")
    ]
    assert len(speeds) == 1
    assert "palpate-host demo --lockstep" in speeds[0]
