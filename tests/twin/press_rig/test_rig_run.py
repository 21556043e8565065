"""The press rig's run on the twin's dome: what it finds, and how it stops and goes on."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.twin.press_rig.rig_trial import PowerCutError, RigTrial

from palpate_edge.common.errors import RigError
from palpate_edge.press_rig.journal import read_journal
from palpate_twin.camera.renderer import CameraView
from palpate_twin.press_rig.virtual_rig import Placement

pytestmark = pytest.mark.long

CENTRE_TOLERANCE_MM = 0.3


def _finish(trial: RigTrial, taken: int) -> None:
    """Go on with a run of which so many frames are taken; nothing is lost, nothing is taken twice."""
    before = trial.files.journal.records
    assert len(before) == trial.taken == taken
    trial.run()
    records = trial.files.journal.records
    assert records[: len(before)] == before
    assert sorted(record.index for record in records) == list(range(7))
    assert trial.is_clear


def test_a_run_on_a_dome_5_mm_off_centre(tmp_path: Path, view: CameraView) -> None:
    """The centre is found; each press is at its place, as deep and as heavy as the journal has it."""
    trial = RigTrial(tmp_path / "presses", view, Placement((4.0, -3.0, 0.0)), presses=6)
    trial.rig.printer.damage_next = True  # noise on the cable costs a line and no more
    trial.run()
    assert trial.core.printer.resends == 1
    assert trial.sequence.place is not None
    off_mm = np.subtract(trial.sequence.place.centre_mm, trial.rig.centre_mm)
    assert np.abs(off_mm).max() < CENTRE_TOLERANCE_MM
    assert np.abs(off_mm[:2]).max() < 0.1
    assert trial.is_clear
    assert len(list((trial.files.folder / "reference").glob("*.png"))) == 8
    records = trial.files.journal.records
    to_printer = Placement((4.0, -3.0, 0.0)).to_printer
    for number, record in enumerate(records):
        press, force_N = trial.truth[number]
        image = cv2.imread(str(trial.files.folder / "frames" / record.frame))
        assert image.shape == (480, 640, 3)
        if record.outward is None:
            assert press is None
            continue
        assert press is not None
        away_mm = 31.24 * np.linalg.norm(to_printer @ press.outward - record.outward)
        assert away_mm < 0.3
        assert press.depth_mm == pytest.approx(record.depth_mm, abs=0.3)
        assert math.hypot(*press.shear_mm) == pytest.approx(math.hypot(*record.slide_mm), abs=0.1)
        assert record.weight_N == pytest.approx(
            -(to_printer @ force_N)[2], abs=4 * record.weight_sd_N + 0.003
        )


def test_a_scale_that_falls_silent_lifts_the_ball_off(trial: RigTrial) -> None:
    def cut_the_cable(trial: RigTrial) -> None:
        if trial.is_pressing and len(trial.files.journal.records) == 3:
            trial.rig.scale.is_silent = True

    with pytest.raises(RigError, match="no reading for 2 s"):
        trial.run(cut_the_cable)
    assert trial.is_clear
    trial.rig.scale.is_silent = False
    _finish(trial, taken=3)


@pytest.mark.slow
def test_a_printer_that_falls_silent_ends_the_run(trial: RigTrial) -> None:
    def pull_the_plug(trial: RigTrial) -> None:
        if trial.is_pressing and len(trial.files.journal.records) == 2:
            trial.rig.printer.is_silent = True

    with pytest.raises(RigError, match="printer is silent for 10 s after"):
        trial.run(pull_the_plug)
    trial.restart_printer()
    _finish(trial, taken=2)


@pytest.mark.slow
def test_ctrl_c_lifts_the_ball_off(trial: RigTrial) -> None:
    def interrupt(trial: RigTrial) -> None:
        if trial.is_pressing and len(trial.files.journal.records) == 4:
            trial.core.stop("stopped")

    with pytest.raises(RigError, match="stopped"):
        trial.run(interrupt)
    assert trial.is_clear
    _finish(trial, taken=4)


def test_after_a_power_cut_the_run_goes_on(trial: RigTrial) -> None:
    """The cut comes between a frame and its record, the worst moment: the frame is taken again."""

    def cut_the_power(trial: RigTrial) -> None:
        if trial.is_pressing and len(trial.files.journal.records) == 5:
            trial.files.folder.joinpath("frames", "00006.png").write_bytes(b"half")
            raise PowerCutError

    with pytest.raises(PowerCutError):
        trial.run(cut_the_power)
    trial.restart_printer()
    _finish(trial, taken=5)
    for record in trial.files.journal.records:
        assert cv2.imread(str(trial.files.folder / "frames" / record.frame)) is not None
    assert read_journal(trial.files.folder) == trial.files.journal


def test_without_a_probe_no_touch_is_found(trial: RigTrial) -> None:
    trial.rig.remove_probe()
    with pytest.raises(RigError, match="no touch found at polar angle 0 deg"):
        trial.run()
    assert trial.is_clear
    assert trial.taken == 0
    assert not any(line.startswith("dome found") for line in trial.lines)


@pytest.mark.slow
def test_a_probe_that_falls_off_is_noticed_after_three_presses(trial: RigTrial) -> None:
    def drop(trial: RigTrial) -> None:
        if trial.rig.has_probe and len(trial.files.journal.records) == 2:
            trial.rig.remove_probe()

    with pytest.raises(RigError, match="3 presses in a row gave no force"):
        trial.run(drop)
    trial.restart_printer()
    _finish(trial, taken=2)


@pytest.mark.parametrize(("extra_N", "message", "halts"), [(7.0, "lifted off", False), (20.0, "M112", True)])
def test_a_force_over_the_limit_stops_the_run(
    trial: RigTrial, extra_N: float, message: str, halts: bool
) -> None:
    def lean(trial: RigTrial) -> None:
        if trial.is_pressing:
            trial.rig.scale.extra_N = extra_N

    with pytest.raises(RigError, match=message):
        trial.run(lean)
    trial.rig.advance(trial.now_us, b"M112\n" if halts else b"")
    assert trial.rig.printer.is_halted == halts
    assert trial.is_clear != halts
