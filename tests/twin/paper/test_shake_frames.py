"""The pose law in the whole chain with contacts estimated from rendered frames: a turn, a move, a push."""

from dataclasses import replace

import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.config import hand_reader
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_twin.cli.options import PACKAGED
from palpate_twin.paper.shake import make_sensors, run_in_chain, shake_cases
from palpate_twin.paper.trial_parameters import Trial

HAND = PACKAGED["table4-wide"]
BASE = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), duration_s=4.0, law=ControlLaw.POSE)


@pytest.fixture(scope="module")
def sensors(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sensors")
    make_sensors(folder, hand_reader.load(HAND), BASE.seed, lambda _text: None)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "on_the_way_mm", "at_the_end_mm", "slip_mm"),
    [
        ("roll 30 deg", 3.0, 1.0, 0.2),
        ("pitch 30 deg", 3.0, 1.0, 0.2),  # its internal forces need a friction of 0.49 of 0.5
        ("yaw 30 deg", 3.0, 1.0, 0.2),
        ("move 10 mm along x", 1.0, 0.5, 0.2),
        ("move 10 mm along z", 1.0, 0.5, 0.2),
        ("push 2 N for 0.2 s", 9.0, 0.5, 0.2),
    ],
)
def test_contacts_from_frames_hold_the_object(sensors, name, on_the_way_mm, at_the_end_mm, slip_mm):
    """A turn moves the centre of mass by 0.6 mm, as it is 1 mm below the point about which it turns."""
    case = next(case for case in shake_cases(BASE, 1) if case.name == name)
    held = run_in_chain(HAND, case, sensors)
    assert held.lost_s is None
    assert held.error_deg < 0.5
    assert held.moved_most_mm < on_the_way_mm
    assert held.moved_last_mm < at_the_end_mm
    assert held.slip_mm < slip_mm


@pytest.mark.slow
def test_a_finger_whose_contacts_are_far_off_does_not_turn_the_object(tmp_path):
    """These sensors' second finger is 1.5 mm off near its apex, with a 95 % radius of 0.6 mm."""
    trial = replace(BASE, seed=7)
    make_sensors(tmp_path, hand_reader.load(HAND), trial.seed, lambda _text: None)
    for case in shake_cases(trial, 1):
        if case.name in ("roll 30 deg", "move 10 mm along z"):
            held = run_in_chain(HAND, case, tmp_path)
            assert held.error_deg < 0.5
            assert held.moved_last_mm < 0.5
            assert held.slip_mm < 0.2


def test_only_the_pose_law_moves_an_object():
    names = [case.name for case in shake_cases(BASE, 1)]
    assert [name for name in names if name.startswith("move")] == [f"move 10 mm along {a}" for a in "xyz"]
    paper = [case.name for case in shake_cases(replace(BASE, law=ControlLaw.PAPER), 1)]
    assert paper == [name for name in names if not name.startswith("move")]


def test_frames_need_the_chain(tmp_path):
    result = CliRunner().invoke(cli, ["simulate", "shake", "--frames", "-o", str(tmp_path / "shake")])
    assert result.exit_code == 2
    assert "--frames needs --chain" in result.output
    assert not (tmp_path / "shake").exists()
