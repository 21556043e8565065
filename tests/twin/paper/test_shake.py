"""Pushes on a held object: the runs, their figures, the command."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_host.cli.main import cli
from palpate_host.config.control_config import ControlLaw, ControlMode
from palpate_twin.cli.options import PACKAGED
from palpate_twin.paper.shake import (
    Held,
    directions,
    run_in_chain,
    run_shake,
    shake_cases,
    shake_table,
    slip_cases,
)
from palpate_twin.paper.trial import run_trial
from palpate_twin.paper.trial_parameters import Trial

HAND = PACKAGED["table4-wide"]
BASE = Trial(ControlMode.PROPOSED, (0.0, 0.0, 0.0), duration_s=2.5, integral_per_s=1.0)


@pytest.mark.parametrize(("count", "lengths"), [(1, {1}), (6, {1}), (26, {1, 2, 3})])
def test_directions_are_distinct_unit_vectors(count, lengths):
    vectors = np.array(directions(count))
    assert len(np.unique(vectors.round(6), axis=0)) == count
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0)
    assert {int(np.count_nonzero(vector)) for vector in vectors} == lengths


def test_the_papers_law_keeps_the_orientation_and_not_the_place():
    """A push of 2 N for 0.2 s moves the object for good: nothing in Eqs. (9)-(16) brings it back."""
    push = next(case for case in shake_cases(BASE, 1) if case.name.startswith("push 2 N"))
    held = run_shake(HAND, push)
    assert held.lost_s is None
    assert held.error_deg < 0.1
    assert 25.0 < held.moved_later_mm < 35.0


def test_a_push_that_friction_cannot_hold_loses_the_object():
    push = next(case for case in shake_cases(BASE, 1) if case.name.startswith("push 5 N"))
    held = run_shake(HAND, push)
    assert 1.0 < held.lost_s < 2.0
    assert held.slip_mm > 10.0


@pytest.mark.parametrize("name", ["push 3 N", "own weight"])
def test_the_pose_law_brings_the_object_back(name):
    """A push of 3 N for 0.2 s, or the weight that nobody announced: within 1 mm a second later."""
    base = replace(BASE, law=ControlLaw.POSE, noise_mm=0.15)
    held = run_shake(HAND, next(case for case in shake_cases(base, 1) if case.name.startswith(name)))
    assert held.lost_s is None
    assert held.error_deg < 0.5
    assert held.moved_most_mm < 4.0
    assert held.moved_last_mm < 0.5
    assert held.slip_mm < 0.2


SLIPPING = replace(BASE, law=ControlLaw.POSE, noise_mm=0.15, force_noise=0.03)


def test_an_object_that_slips_is_caught():
    """3 N along -z, and friction falls from 0.5 to 0.3: without the reflex the object falls out."""
    dropped = run_shake(HAND, slip_cases(replace(SLIPPING, slip_reflex=False))[0])
    assert 1.0 < dropped.lost_s < 1.6
    caught = run_shake(HAND, slip_cases(SLIPPING)[0])
    assert caught.lost_s is None
    assert caught.slip_mm < 12.0
    assert caught.error_deg < 0.5


def test_an_object_is_caught_early_by_fast_fingertips():
    """120 frames a second that arrive after 10 ms."""
    caught = run_shake(HAND, slip_cases(replace(SLIPPING, frame_rate_Hz=120.0, delay_s=0.01))[0])
    assert caught.slip_mm < 2.5


@pytest.mark.slow
def test_a_turn_ends_where_friction_ends():
    """The internal forces of 30 deg of pitch need a friction of 0.49: with 0.3 the tips slide by 13 mm."""
    slid = run_shake(HAND, slip_cases(replace(SLIPPING, slip_reflex=False))[1])
    assert slid.slip_mm > 8.0
    rested = run_shake(HAND, slip_cases(SLIPPING)[1])
    assert rested.slip_mm < 2.0
    assert rested.moved_most_mm < 2.0
    assert 5.0 < rested.error_deg < 20.0  # the rest of the turn


@pytest.mark.parametrize("axis", ["roll", "pitch", "yaw"])
def test_the_pose_law_turns_the_object_in_its_place(axis):
    """30 deg in 2 s; the centre of mass is 1 mm below the point about which it turns."""
    base = replace(BASE, law=ControlLaw.POSE)
    held = run_shake(HAND, next(case for case in shake_cases(base, 1) if case.name.startswith(axis)))
    assert held.error_deg < 0.5
    assert held.moved_most_mm < 1.0
    assert held.slip_mm < 0.2


@pytest.mark.parametrize("axis", range(3))
def test_the_pose_law_moves_the_object(axis):
    """10 mm along each of the hand's axes in 2 s."""
    xyz_mm = tuple(float(value) for value in 10.0 * np.eye(3)[axis])
    outcome = run_trial(HAND, "mujoco", replace(BASE, law=ControlLaw.POSE, xyz_mm=xyz_mm))
    moved_mm = 1e3 * (outcome.poses[-1][1] - outcome.poses[0][1])
    np.testing.assert_allclose(moved_mm, xyz_mm, atol=0.5)
    assert outcome.error_deg < 0.5
    assert outcome.slip_mm.max() < 0.2


@pytest.mark.long
def test_the_pose_law_holds_against_a_push_in_the_whole_chain():
    base = replace(BASE, law=ControlLaw.POSE, noise_mm=0.15)
    push = next(case for case in shake_cases(base, 1) if case.name.startswith("push 3 N"))
    held = run_in_chain(HAND, push)
    assert held.lost_s is None
    assert held.error_deg < 0.6
    assert held.moved_later_mm < 1.0
    assert held.slip_mm < 0.3


def test_a_row_has_the_worst_of_its_directions_that_kept_the_object():
    runs = [
        Held("push 1 N", 0.5, 2.0, 1.0, 0.9, 0.1, None),
        Held("push 1 N", 0.2, 3.0, 0.5, 0.4, 0.3, 1.5),
        Held("own weight", 0.0, 4.0, None, 4.0, 0.0, None),
        Held("steady 1 N", 3.0, 9837.4, None, 9837.4, 59.7, 0.4),
    ]
    rows = shake_table(runs).splitlines()[2:]
    assert rows == [
        "| push 1 N | 0.50 | 2.0 | 1.0 | 0.9 | 0.30 | 1 of 2 |",
        "| own weight | 0.00 | 4.0 |  | 4.0 | 0.00 |  |",
        "| steady 1 N |  |  |  |  | 59.70 | 1 of 1 |",
    ]


@pytest.mark.slow
def test_simulate_shake_writes_its_table(tmp_path):
    result = CliRunner().invoke(
        cli, f"simulate shake --seconds 2.5 --jobs 2 -o {tmp_path}".split(), catch_exceptions=False
    )
    assert result.exit_code == 0, result.output
    rows = (tmp_path / "results.md").read_text().splitlines()[2:]
    names = [row.split("|")[1].strip() for row in rows]
    assert names[0] == "push 0.5 N for 0.2 s"
    assert [name for name in names if "weight" in name or "lift" in name] == [
        "own weight",
        *(f"lift {mass} kg in 1 s" for mass in ("0.05", "0.1", "0.2", "0.3")),
    ]
    assert names[-5:-2] == ["roll 30 deg", "pitch 30 deg", "yaw 30 deg"]
    assert names[-2:] == ["friction falls to 0.3 under 3 N", "friction falls to 0.3 at pitch 30 deg"]
