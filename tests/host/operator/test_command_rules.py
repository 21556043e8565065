"""Which command is obeyed in which mode: every mode in turn, and what must be done first."""

import pytest

from palpate_host.common.command import CommandError, Grasp, Move, Recover, Release, Reorient, Rotate, Stop
from palpate_host.common.mode import Mode
from palpate_host.operator.command_rules import check_allowed
from palpate_host.safety.supervisor import Decision, Goal

TURN = Rotate((0.0, 0.0, 10.0))
MOVING = {Mode.GRASP, Mode.HOLD, Mode.MANIPULATE, Mode.BLIND, Mode.RELEASE}
STOPPED = {Mode.FAULT, Mode.STOP}


def obeyed_in(command, goal=Goal.GRASP, **situation):
    situation = {"is_ending": False, "bus_lost": False, "is_off": True} | situation
    modes, refusals = set(), {}
    for mode in Mode:
        try:
            check_allowed(command, Decision(mode, "why", 0), goal, **situation)
            modes.add(mode)
        except CommandError as refused:
            refusals[mode] = str(refused)
    return modes, refusals


def test_a_stop_is_obeyed_in_every_mode():
    assert obeyed_in(Stop(), is_ending=True, bus_lost=True, is_off=False)[0] == set(Mode)


@pytest.mark.parametrize(("command", "name"), [(Grasp(), "grasp"), (Release(), "release")])
def test_grasp_and_release_wait_for_a_ready_hand(command, name):
    modes, refusals = obeyed_in(command)
    assert modes == {Mode.READY} | MOVING
    assert refusals[Mode.INIT] == f"{name} is refused in mode init (why): wait until it is ready"
    assert all(refusals[mode].endswith("recover first") for mode in STOPPED)


def test_only_a_hand_that_grasps_turns():
    far = Reorient((0.0, 0.0, 90.0), ((0.0, 0.0, 0.0),) * 4)
    assert obeyed_in(TURN)[0] == obeyed_in(Move())[0] == obeyed_in(far)[0] == MOVING
    modes, refusals = obeyed_in(TURN, goal=Goal.NOTHING)
    assert not modes and all(text.endswith("grasp first") for text in refusals.values())


def test_recover_leads_out_of_a_stop_whose_drives_are_off_on_a_bus_that_is_there():
    assert obeyed_in(Recover())[0] == STOPPED
    for situation, way_out in (
        ({"is_ending": True}, "nothing to recover from"),
        ({"bus_lost": True}, "the bus is lost"),
        ({"is_off": False}, "still stopping"),
    ):
        modes, refusals = obeyed_in(Recover(), **situation)
        assert not modes and way_out in refusals[Mode.FAULT]
