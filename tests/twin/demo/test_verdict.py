"""The verdict on a run: what it praises and what it does not forgive."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate_twin.demo.analysis import Summary
from palpate_twin.demo.distribution import Distribution
from palpate_twin.demo.hand_motion import HandFigures, JointFigures
from palpate_twin.demo.traffic import Traffic
from palpate_twin.demo.truth import FingerFigures
from palpate_twin.demo.turn import TurnFigures, TurnStep
from palpate_twin.demo.verdict import verdict
from palpate_twin.hand.push_recovery import PushStep

STEP = TurnStep((30.0, 0.0, 0.0), 1.0, 5.0, 0.4, 0.1, (0.0, 0.1, 0.02), 0.4, 1.0)
ERROR = Distribution(90, 0.2, 0.2, 0.4, 0.5, 0.6)
FINGER = FingerFigures("finger-1", 100, 0, 0, 0, 100.0, ERROR, 0.05, 2.0, None)
PUSH = PushStep((0.0, 0.0, -2.0), 7.6, 0.2, 7.2, 0.1)
JOINT = JointFigures("curl_1", 0.3, 0.2, 900, 0)
RUN = Summary(
    started_at="2026-01-01T00:00:00",
    duration_s=10.0,
    bitrate=1_000_000,
    origin={},
    fingers=(FINGER,),
    bus=Traffic(10, 1000, 10.0, 20.0, 25.0, (20.0,), ()),
    hand=HandFigures({}, (), None, (JOINT,)),
    turn=TurnFigures((STEP, replace(STEP, rpy_deg=(-30.0, 0.0, 0.0), error_deg=0.3)), 3.0, 1.0, 0.0, 1.0),
)


def test_a_good_run_is_praised_for_its_worst_turn():
    judged = verdict(RUN)
    assert judged.is_good
    assert judged.headline == "The hand turned the object twice, each time to within 0.40 deg of the target."
    assert judged.grounds[0] == "roll +30 deg: reached within 0.40 deg, no slip (0.10 mm)."
    assert (
        "finger-1: contact 0.20 mm from the truth on average, force 0.05 N RMSE; 0 of 100 frames dropped"
        in (judged.grounds[2])
    )
    assert judged.grounds[-1] == "No torque command was above its limit."


def test_pushes_that_were_held_are_part_of_the_headline():
    one = verdict(replace(RUN, pushes=(PUSH,)))
    assert one.is_good
    assert one.headline == (
        "The hand turned the object twice, each time to within 0.40 deg of the target, and held it against a"
        " push: back within 0.1 mm."
    )
    assert "push 2 N along -z for 0.2 s: moved by 7.2 mm, back within 0.1 mm after 1 s." in one.grounds
    two = verdict(replace(RUN, pushes=(PUSH, replace(PUSH, remaining_mm=0.3))))
    assert two.headline.endswith("held it against 2 pushes: back within 0.3 mm.")


@pytest.mark.parametrize(
    ("run", "words"),
    [
        (replace(RUN, pushes=(replace(PUSH, remaining_mm=30.0),)), "push 2 N along -z for 0.2 s not held"),
        (replace(RUN, fingers=(replace(FINGER, dropped=3),)), "finger-1 dropped 3 frames"),
        (replace(RUN, fingers=(replace(FINGER, position_error_mm=None),)), "finger-1 published no contact"),
        (
            replace(RUN, hand=replace(RUN.hand, joints=(replace(JOINT, over_limit=2),))),
            "2 torque commands",
        ),
        (replace(RUN, turn=replace(RUN.turn, steps=(replace(STEP, error_deg=20.0),))), "roll +30 deg missed"),
    ],
)
def test_a_fault_is_named_in_the_headline(run, words):
    judged = verdict(run)
    assert not judged.is_good
    assert judged.headline.startswith("Not as it should be: ")
    assert words in judged.headline


def test_a_run_without_turns_is_judged_by_the_rest():
    assert verdict(replace(RUN, turn=None)).headline == "The programs ran without a fault."
