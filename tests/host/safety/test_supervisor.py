"""The modes' ladder in virtual time, row by row as the configuration promises it."""

import dataclasses

import pytest

from palpate_host.common.mode import STOPPED, Mode
from palpate_host.safety.supervisor import NO_PLACE, Decision, FingerHealth, Goal, Inputs, Tiers, decide

TIERS = Tiers(
    warn_us=100, freeze_us=200, hold_us=1000, stop_us=3000, lost_us=250, settle_us=500, release_us=400
)
FRESH = FingerHealth(
    "finger-1", frame_age_us=30, contact_age_us=30, in_contact=True, heartbeat_timed_out=False
)
GOOD = Inputs(
    now_us=10_000,
    stop="",
    fault="",
    missing="",
    unchecked="",
    homing="",
    drives_waiting="",
    no_virtual_frame="",
    no_contact_frame="",
    blind_by_choice=False,
    goal=Goal.TURN,
    fingers=(FRESH, FRESH, FRESH),
)


def at(mode, since_us=0):
    return Decision(mode, "", since_us)


def with_finger(**changes):
    changed = dataclasses.replace(FRESH, name="finger-2", **changes)
    return dataclasses.replace(GOOD, fingers=(FRESH, changed, FRESH))


def test_start_up_waits_for_nodes_drives_frames_and_the_grasp():
    stages = [
        ({"missing": "node 3", "unchecked": "node 3"}, Mode.INIT, "waiting for node 3"),
        ({"unchecked": "node 4"}, Mode.CHECK, "waiting for node 4"),
        ({"homing": "drive of curl_1"}, Mode.HOME, "homing drive of curl_1"),
        ({"drives_waiting": "drive of curl_1"}, Mode.READY, "waiting for drive of curl_1"),
    ]
    last = at(Mode.INIT)
    for changes, mode, reason in stages:
        last = decide(last, dataclasses.replace(GOOD, **changes), TIERS)
        assert (last.mode, last.reason) == (mode, reason)
    last = decide(last, with_finger(frame_age_us=None, contact_age_us=None), TIERS)
    assert (last.mode, last.reason) == (Mode.READY, "waiting for a valid frame of finger-2")
    last = decide(last, GOOD, TIERS)
    assert last.mode is Mode.GRASP
    assert decide(last, dataclasses.replace(GOOD, now_us=10_499), TIERS).mode is Mode.GRASP
    assert decide(last, dataclasses.replace(GOOD, now_us=10_500), TIERS).mode is Mode.MANIPULATE


def test_a_hand_that_waits_for_commands_moves_by_them_alone():
    """READY, grasp, turn, hold on without turning, release, READY: each by its goal."""
    goals = [
        (Goal.NOTHING, 0, Mode.READY),
        (Goal.GRASP, 10_000, Mode.GRASP),
        (Goal.GRASP, 20_000, Mode.GRASP),
        (Goal.TURN, 30_000, Mode.MANIPULATE),
        (Goal.GRASP, 31_000, Mode.GRASP),
        (Goal.NOTHING, 32_000, Mode.RELEASE),
        (Goal.NOTHING, 32_399, Mode.RELEASE),
        (Goal.NOTHING, 32_400, Mode.READY),
    ]
    last = at(Mode.READY)
    for goal, now_us, mode in goals:
        last = decide(last, dataclasses.replace(GOOD, goal=goal, now_us=now_us), TIERS)
        assert last.mode is mode, (goal, now_us, last)
    assert "command grasp" in decide(last, dataclasses.replace(GOOD, goal=Goal.NOTHING), TIERS).reason


def test_a_grasp_waits_for_its_contacts_and_a_turn_that_lost_them_holds():
    nothing_yet = with_finger(in_contact=False, contact_age_us=None)
    assert decide(at(Mode.GRASP), nothing_yet, TIERS).mode is Mode.GRASP
    assert decide(at(Mode.MANIPULATE), nothing_yet, TIERS).mode is Mode.HOLD
    assert decide(at(Mode.RELEASE), GOOD, TIERS).mode is Mode.GRASP


@pytest.mark.parametrize(
    ("changes", "mode", "reason"),
    [
        ({"contact_age_us": 100}, Mode.MANIPULATE, "every finger"),
        ({"contact_age_us": 200}, Mode.MANIPULATE, "every finger"),
        ({"contact_age_us": 201}, Mode.BLIND, "finger-2: contact older"),
        ({"in_contact": False, "contact_age_us": 1}, Mode.BLIND, "finger-2: no contact"),
        ({"contact_age_us": 1000}, Mode.BLIND, "finger-2"),
        ({"contact_age_us": 1001}, Mode.HOLD, "finger-2: no contact for more"),
        ({"heartbeat_timed_out": True}, Mode.HOLD, "finger-2: heartbeat lost"),
        ({"frame_age_us": 3000}, Mode.MANIPULATE, "every finger"),
        ({"frame_age_us": 3001}, Mode.FAULT, "finger-2: no valid frame"),
    ],
)
def test_ladder_from_manipulate(changes, mode, reason):
    decision = decide(at(Mode.MANIPULATE), with_finger(**changes), TIERS)
    assert decision.mode is mode and decision.reason.startswith(reason)


def test_a_finger_left_out_is_a_warning_and_the_turn_goes_on():
    decision = decide(at(Mode.MANIPULATE), dataclasses.replace(GOOD, left_out="finger-2"), TIERS)
    assert decision.mode is Mode.MANIPULATE
    assert decision.warning == "finger-2: contact does not fit the object, left out"


def test_a_slip_is_a_warning_and_the_turn_goes_on():
    decision = decide(at(Mode.MANIPULATE), dataclasses.replace(GOOD, hold_warning="finger-2: slipped"), TIERS)
    assert (decision.mode, decision.warning) == (Mode.MANIPULATE, "finger-2: slipped")


def test_an_old_contact_is_a_warning_first():
    assert decide(at(Mode.MANIPULATE), with_finger(contact_age_us=100), TIERS).warning == ""
    decision = decide(at(Mode.MANIPULATE), with_finger(contact_age_us=101), TIERS)
    assert decision.mode is Mode.MANIPULATE and decision.warning.startswith("finger-2")


def test_blind_recovers_at_once_but_hold_settles_first():
    assert decide(at(Mode.BLIND, 9_999), GOOD, TIERS).mode is Mode.MANIPULATE
    assert decide(at(Mode.HOLD, 9_999), GOOD, TIERS).mode is Mode.HOLD


def test_hold_never_goes_blind_for_it_has_no_frame_to_freeze():
    assert decide(at(Mode.HOLD), with_finger(in_contact=False), TIERS).mode is Mode.HOLD


def test_frames_that_do_not_exist():
    no_contacts = dataclasses.replace(GOOD, no_contact_frame="parallel")
    assert decide(at(Mode.MANIPULATE), no_contacts, TIERS).mode is Mode.BLIND
    no_tips = dataclasses.replace(GOOD, no_virtual_frame="on one line")
    assert decide(at(Mode.MANIPULATE), no_tips, TIERS).mode is Mode.HOLD
    assert decide(at(Mode.BLIND), dataclasses.replace(no_tips, blind_by_choice=True), TIERS).mode is Mode.HOLD


def test_blind_by_choice_needs_no_fingertip():
    gone = FingerHealth("finger-1", None, None, False, True)
    inputs = dataclasses.replace(GOOD, blind_by_choice=True, fingers=(gone, gone, gone))
    assert decide(at(Mode.READY), inputs, TIERS).mode is Mode.GRASP
    assert decide(at(Mode.HOLD, 0), inputs, TIERS).mode is Mode.BLIND
    assert decide(at(Mode.HOLD, 9_999), inputs, TIERS).mode is Mode.HOLD


@pytest.mark.parametrize("mode", [mode for mode in Mode if mode not in STOPPED])
def test_every_mode_stops_and_a_stopped_hand_stays_so(mode):
    broken = decide(at(mode), dataclasses.replace(GOOD, fault="drive of curl_1: fault"), TIERS)
    assert (broken.mode, broken.reason) == (Mode.FAULT, "drive of curl_1: fault")
    assert decide(broken, GOOD, TIERS) is broken
    stopped = decide(at(mode), dataclasses.replace(GOOD, stop="the operator"), TIERS)
    assert (stopped.mode, stopped.reason) == (Mode.STOP, "the operator")
    assert decide(stopped, GOOD, TIERS) is stopped


def test_since_moves_only_with_the_mode():
    decision = decide(at(Mode.MANIPULATE, 123), GOOD, TIERS)
    assert decision.since_us == 123
    assert decide(decision, with_finger(in_contact=False), TIERS).since_us == 10_000


def test_a_force_that_is_never_known_keeps_the_hand_from_grasping():
    """limits.contact_force_N cannot be kept then, unless it is inf or the law needs no fingertip."""
    unknown = with_finger(gives_no_force=True)
    ready = decide(at(Mode.READY), unknown, TIERS)
    assert ready.mode is Mode.READY
    assert ready.reason.startswith(
        "finger-2: gives no contact force, so limits.contact_force_N cannot be kept"
    )
    assert decide(at(Mode.GRASP), unknown, TIERS).mode is Mode.FAULT
    for accepted in ({"force_is_limited": False}, {"blind_by_choice": True}):
        assert decide(at(Mode.READY), dataclasses.replace(unknown, **accepted), TIERS).mode is Mode.GRASP


def test_a_place_that_is_never_known_holds_and_does_not_turn():
    unknown = dataclasses.replace(
        with_finger(gives_no_place=True, gives_no_force=True), force_is_limited=False
    )
    grasp = decide(at(Mode.READY), unknown, TIERS)
    held = decide(grasp, dataclasses.replace(unknown, now_us=20_000), TIERS)
    assert (held.mode, held.reason) == (Mode.GRASP, f"finger-2: {NO_PLACE}")
    assert decide(at(Mode.MANIPULATE), unknown, TIERS).mode is Mode.BLIND
    by_choice = dataclasses.replace(unknown, blind_by_choice=True)
    assert decide(at(Mode.GRASP), by_choice, TIERS).mode is Mode.BLIND


def fingers(*contact_ages_us, frame_age_us=30):
    """Fingers that touched so long ago; 30 us are a contact, anything older is a frame without one."""
    return tuple(
        dataclasses.replace(
            FRESH,
            name=f"finger-{number}",
            contact_age_us=age,
            in_contact=age == 30,
            frame_age_us=frame_age_us,
        )
        for number, age in enumerate(contact_ages_us, start=1)
    )


@pytest.mark.parametrize("mode", [Mode.GRASP, Mode.MANIPULATE, Mode.BLIND, Mode.HOLD])
@pytest.mark.parametrize("goal", [Goal.GRASP, Goal.TURN])
def test_an_object_that_fewer_than_two_fingers_touch_is_lost(mode, goal):
    decision = decide(at(mode), dataclasses.replace(GOOD, goal=goal, fingers=fingers(30, 250, 260)), TIERS)
    assert decision.mode is Mode.FAULT
    assert decision.reason == "the object is lost: no contact of finger-2, finger-3 for 0 ms"


@pytest.mark.parametrize(
    "held",
    [
        fingers(30, 30, 900),  # two fingers hold it
        fingers(30, 249, 249),  # not long enough
        fingers(30, 250, 250, frame_age_us=101),  # silent fingertips may be touching
    ],
)
def test_an_object_that_may_be_held_is_not_lost(held):
    assert decide(at(Mode.HOLD), dataclasses.replace(GOOD, fingers=held), TIERS).mode is not Mode.FAULT


def test_a_grasp_that_has_not_closed_yet_has_lost_nothing():
    """Contacts of the grasp before, 400 us ago, with this one begun 300 us ago; and fingers never touched."""
    for ages in ((400, 400, 400), (30, 270, None)):
        inputs = dataclasses.replace(GOOD, now_us=10_300, fingers=fingers(*ages))
        assert decide(at(Mode.GRASP, 10_000), inputs, TIERS).mode is Mode.GRASP


def test_a_blind_hand_loses_nothing():
    inputs = dataclasses.replace(GOOD, blind_by_choice=True, fingers=fingers(900, 900, 900))
    assert decide(at(Mode.BLIND), inputs, TIERS).mode is Mode.BLIND


LIFTED = dataclasses.replace(
    FRESH, name="finger-2", contact_age_us=9000, in_contact=False, is_lifted=True, frame_age_us=30
)
GAIT = "turning by finger gaiting: carry, finger-2 is lifted"


def lifting(lifted=LIFTED, **changes):
    """Four fingers turn an object by gaiting; finger-2 is lifted. changes: of finger-3."""
    third = dataclasses.replace(FRESH, name="finger-3", **changes)
    return dataclasses.replace(GOOD, fingers=(FRESH, lifted, third, FRESH), gait=GAIT)


def test_a_lifted_finger_needs_no_contact_and_is_the_reason():
    decision = decide(at(Mode.MANIPULATE), lifting(), TIERS)
    assert (decision.mode, decision.reason, decision.warning) == (Mode.MANIPULATE, GAIT, "")


@pytest.mark.parametrize(
    ("frame_age_us", "mode", "reason"),
    [
        (200, Mode.MANIPULATE, GAIT),
        (201, Mode.BLIND, "finger-2: lifted, frame older than 0 ms"),
        (1001, Mode.HOLD, "finger-2: lifted, no frame for more than 1 ms"),
        (3001, Mode.FAULT, "finger-2: no valid frame for more than 3 ms"),
    ],
)
def test_the_frames_of_a_lifted_finger_have_tiers_of_their_own(frame_age_us, mode, reason):
    inputs = lifting(dataclasses.replace(LIFTED, frame_age_us=frame_age_us))
    decision = decide(at(Mode.MANIPULATE), inputs, TIERS)
    assert (decision.mode, decision.reason) == (mode, reason)


@pytest.mark.parametrize(
    ("changes", "mode"),
    [
        ({"in_contact": False, "contact_age_us": 60}, Mode.BLIND),
        ({"contact_age_us": 201, "frame_age_us": 201}, Mode.BLIND),
        ({"in_contact": False, "contact_age_us": 1001}, Mode.HOLD),
        ({"heartbeat_timed_out": True}, Mode.HOLD),
        ({"unverified": "finger-3: reading"}, Mode.HOLD),
        ({"contact_age_us": 3001, "frame_age_us": 3001}, Mode.FAULT),
    ],
)
def test_doubt_about_a_finger_that_holds_while_another_is_lifted(changes, mode):
    decision = decide(at(Mode.MANIPULATE), lifting(**changes), TIERS)
    assert decision.mode is mode
    assert "finger-3" in decision.reason


def test_a_lifted_finger_does_not_count_as_holding():
    """One of three fingers may lose the object while the fourth is lifted, not two."""
    lost = {"in_contact": False, "contact_age_us": 250}
    assert decide(at(Mode.BLIND), lifting(**lost), TIERS).mode is Mode.BLIND
    two = lifting(**lost)
    two = dataclasses.replace(two, fingers=(*two.fingers[:3], dataclasses.replace(FRESH, **lost)))
    decision = decide(at(Mode.BLIND), two, TIERS)
    assert decision.mode is Mode.FAULT
    assert decision.reason.startswith("the object is lost")
