"""The texts and limits of a hold, from states that are given."""

from types import SimpleNamespace

import pytest

from palpate_host.control.gait.gait import GaitPhase
from palpate_host.control.hold_report import gait_text, hold_fault, hold_warning

CONFIG = SimpleNamespace(reach_mm=20.0, reach_deg=45.0, most_grip_N=5.0)
NAMES = ("thumb", "index", "ring")


def control(law=None, gait=None, request=None, problem="", lowered=(), waits=False):
    return SimpleNamespace(
        pose_law=law,
        gait=gait,
        reorientation=SimpleNamespace(request=request, problem=problem),
        friction=SimpleNamespace(tips=[SimpleNamespace(is_lowered=name in lowered) for name in NAMES]),
        turn_waits=waits,
    )


def law(moved_mm=0.0, turned_deg=0.0, known=True, at_limit=False, held=True):
    return SimpleNamespace(
        moved_mm=moved_mm,
        turned_deg=turned_deg,
        is_load_known=known,
        is_grip_at_limit=at_limit,
        object=object() if held else None,
    )


@pytest.mark.parametrize(
    ("moved_mm", "turned_deg", "ends"),
    [(39.9, 89.9, False), (40.1, 0.0, True), (0.0, 90.1, True), (0.0, 0.0, False)],
)
def test_a_hold_ends_at_twice_the_workspace(moved_mm, turned_deg, ends):
    text = hold_fault(control(law(moved_mm, turned_deg)), CONFIG)
    assert text.startswith("the object is far beyond the workspace, pose_law.reach_mm = 20") is ends
    assert hold_fault(control(), CONFIG) == ""


@pytest.mark.parametrize(
    ("moved_mm", "turned_deg", "is_named"), [(19.9, 44.9, False), (20.1, 0.0, True), (0.0, 45.1, True)]
)
def test_an_object_beyond_the_workspace_is_a_warning(moved_mm, turned_deg, is_named):
    text = hold_warning(control(law(moved_mm, turned_deg)), CONFIG, NAMES)
    assert ("beyond the workspace" in text) is is_named


def test_all_that_is_unusual_is_named():
    found = hold_warning(
        control(law(known=False, at_limit=True), problem="no plan", lowered=("index", "ring"), waits=True),
        CONFIG,
        NAMES,
    ).split("; ")
    assert found == [
        "index, ring: slipped, so less friction is assumed, and the turn waits where friction holds",
        "no plan",
        "weight unknown: the load on the object is being learned",
        "grip at its limit: the load needs more than most_grip_N = 5",
    ]
    assert hold_warning(control(law()), CONFIG, NAMES) == ""
    assert hold_warning(control(law(known=False, held=False)), CONFIG, NAMES) == ""
    only = hold_warning(control(lowered=("thumb",)), CONFIG, NAMES)
    assert only == "thumb: slipped, so less friction is assumed"


@pytest.mark.parametrize(
    ("phase", "away", "text"),
    [
        (GaitPhase.TURN, None, "turning by finger gaiting: turn"),
        (GaitPhase.CARRY, 1, "turning by finger gaiting: carry, index is lifted"),
        (GaitPhase.DONE, None, ""),
        (GaitPhase.STOPPED, None, "why"),
        (GaitPhase.STOPPED, 2, "why; ring is lifted: palpate-host command grasp lets it take hold"),
    ],
)
def test_what_a_gait_does(phase, away, text):
    gait = SimpleNamespace(phase=phase, away=away, reason="why")
    assert gait_text(control(gait=gait), NAMES) == text
    assert gait_text(control(), NAMES) == ""
    planned = control(gait=gait, request=object())
    assert gait_text(planned, NAMES) == "holding: a turn by finger gaiting is being planned"
