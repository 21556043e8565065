"""Goals of actions, tick by tick: what ends them, and with which reason."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import pytest

from palpate_host.common.command import Command, CommandError, Grasp, Move, Release, Reorient, Rotate, Stop
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, HoldStatus, HostStatus
from palpate_host.common.tick_inputs import BusLost, HostEvent, HostInput, Planned, TickInputs
from palpate_host.ros.goal_requests import GoalRequest, GoalRules
from palpate_host.ros.goals import GoalOutcome, GoalProgress, values_of

TICK_US = 10_000
RULES = GoalRules("hand", ramp_s=3.0, measured_in=(Mode.MANIPULATE,))
TURN = RULES.turn((0.0, 0.0, 0.5), 1.0, math.radians(1.0), 2.0)
CORNERS_M = ((0.02, 0.0, 0.1), (-0.02, 0.0, 0.1), (0.0, 0.02, 0.1), (0.0, 0.0, 0.12))
REORIENT = RULES.reorient((0.0, 0.0, math.pi / 2), CORNERS_M, 0.0)
NO_TURN = (0.0, 0.0, 0.0, 1.0)


def status(
    tick: int,
    mode: Mode = Mode.MANIPULATE,
    error_deg: float | None = 0.2,
    turned: float = 1.0,
    events: Iterable[HostEvent] = (),
    event_count: int = 1,
    place_error_mm: float | None = None,
) -> HostStatus:
    hold = HoldStatus((), (), (), (), None, False, place_error_mm=place_error_mm)
    inputs = TickInputs(0, 0, 0, tuple(HostInput(0, event) for event in events), event_count)
    return HostStatus(
        *(tick * TICK_US, mode, "because", "", (), (), None, None, None, None),
        *(error_deg, None, None, "", Counters(), turned, (), inputs, hold),
    )


def ends(request: GoalRequest, ticks: Iterable[HostStatus]) -> tuple[int, GoalOutcome] | None:
    """Return the tick at which the goal ends with its outcome, None when it stays open."""
    progress = GoalProgress(request.command, status(0), request.judge, request.timeout_s)
    for one in ticks:
        if outcome := progress.of_tick(one):
            return one.time_us // TICK_US, outcome
    return None


def fresh(**changed: float) -> GoalRequest:
    values = {"duration_s": 1.0, "tolerance_rad": math.radians(1.0), "timeout_s": 2.0} | changed
    return RULES.turn((0.0, 0.0, 0.5), **values)


def test_a_turn_is_reached_after_half_a_second_within_the_tolerance() -> None:
    """A tick beyond the tolerance, a ramp that is not done, and a frozen frame start the half second anew."""
    assert ends(fresh(), map(status, range(1, 100))) == (51, GoalOutcome(True))
    for bad in (
        status(20, error_deg=1.1),
        status(20, error_deg=None),
        status(20, turned=0.99),
        status(20, Mode.BLIND),
        status(20, Mode.GRASP),
    ):
        ticks = [*map(status, range(1, 20)), bad, *map(status, range(21, 100))]
        assert ends(fresh(), ticks) == (71, GoalOutcome(True))


def test_the_tick_before_the_command_does_not_count() -> None:
    assert ends(fresh(), [status(0, Mode.FAULT)]) is None


@pytest.mark.parametrize("mode", [Mode.FAULT, Mode.STOP, Mode.RELEASE, Mode.READY])
def test_a_hand_that_leaves_the_hold_ends_the_turn(mode: Mode) -> None:
    assert ends(fresh(), [status(1), status(2, mode)]) == (2, GoalOutcome(False, f"{mode.value}: because"))


def test_hold_ends_a_turn_that_had_begun_and_the_host_is_to_hold() -> None:
    before = [status(tick, Mode.HOLD) for tick in range(1, 50)]
    assert ends(fresh(), before) is None
    ended = GoalOutcome(False, "hold: because", must_hold=True)
    assert ends(fresh(), [*before, status(50), status(51, Mode.HOLD)]) == (51, ended)


def test_an_error_that_stays_ends_at_the_timeout() -> None:
    ticks = [status(tick, error_deg=1.5) for tick in range(1, 300)]
    late = GoalOutcome(False, "not within 2 s (manipulate: because)", must_hold=True)
    assert ends(fresh(), ticks) == (201, late)


@pytest.mark.parametrize("later", [Grasp(), Rotate((1.0, 0.0, 0.0)), Release(), TURN.command])
def test_a_later_command_replaces_the_goal(later: Command) -> None:
    own = [status(1, events=[TURN.command])]
    replaced = GoalOutcome(False, f"replaced by {type(later).__name__.lower()}")
    assert ends(fresh(), [*own, status(2, events=[later], event_count=2)]) == (2, replaced)
    together = [status(1, events=[TURN.command, later], event_count=2)]
    assert ends(fresh(), together) == (1, replaced)


def test_an_earlier_command_in_the_same_tick_replaces_nothing() -> None:
    earlier = [status(1, events=[Grasp(), TURN.command], event_count=2)]
    assert ends(fresh(), [*earlier, status(2, event_count=2)]) is None


def test_a_command_in_a_tick_that_was_missed_replaces_the_goal() -> None:
    ticks = [status(1, events=[TURN.command]), status(3, event_count=2)]
    assert ends(fresh(), ticks) == (3, GoalOutcome(False, "replaced by another command"))
    missed = [status(2), status(3)]  # of the goal's own command
    assert ends(fresh(), missed) is None


def test_the_plan_of_a_turn_by_gaiting_replaces_nothing_also_where_its_tick_was_missed() -> None:
    def first() -> HostStatus:
        return status(1, events=[REORIENT.command])

    planned = status(3, events=[Planned(None, "why")], event_count=2)
    assert ends(REORIENT, [first(), status(2), planned, status(4, event_count=2)]) is None
    assert ends(REORIENT, [first(), status(4, event_count=2), status(5, event_count=2)]) is None
    replaced = GoalOutcome(False, "replaced by another command")
    assert ends(REORIENT, [first(), planned, status(5, event_count=3)]) == (5, replaced)
    assert ends(REORIENT, [first(), status(5, event_count=3)]) == (5, replaced)
    together = status(3, events=[Planned(None, "why"), Grasp()], event_count=3)
    assert ends(REORIENT, [first(), together]) == (3, GoalOutcome(False, "replaced by grasp"))


@pytest.mark.parametrize("event", [Stop(), BusLost(0, "cable")])
def test_a_fault_or_stop_is_named_rather_than_its_event(event: HostEvent) -> None:
    ticks = [status(1), status(2, Mode.FAULT, events=[event], event_count=2)]
    assert ends(fresh(), ticks) == (2, GoalOutcome(False, "fault: because"))


def test_a_move_is_reached_when_the_place_is_too() -> None:
    def move() -> GoalRequest:
        return RULES.move("hand", (0.001, 0.0, 0.0), NO_TURN, 1.0, 0.02, 0.0005, 2.0)

    assert isinstance(move().command, Move)
    near = (status(tick, place_error_mm=0.4) for tick in range(1, 100))
    assert ends(move(), near) == (51, GoalOutcome(True))
    for far_mm in (0.6, None):
        far = (status(tick, place_error_mm=far_mm) for tick in range(1, 199))
        assert ends(move(), far) is None


def test_a_turn_by_gaiting_ends_when_it_is_done_refused_or_stopped_or_the_hold_ends() -> None:
    assert isinstance(REORIENT.command, Reorient)
    assert REORIENT.command.rpy_deg == pytest.approx((0.0, 0.0, 90.0))
    assert REORIENT.command.corners_mm[3] == pytest.approx((0.0, 0.0, 120.0))

    def gaiting(tick: int, gait: str, mode: Mode = Mode.MANIPULATE) -> HostStatus:
        hold = HoldStatus((), (), (), (), None, False, gait=gait, gait_reason=f"why {gait}")
        return replace(status(tick, mode), hold=hold)

    under_way = [gaiting(1, "planning"), gaiting(2, "turn"), gaiting(3, "lift", Mode.BLIND)]
    assert ends(REORIENT, under_way) is None
    for gait in ("done", "refused", "stopped"):
        outcome = GoalOutcome(True) if gait == "done" else GoalOutcome(False, f"why {gait}")
        assert ends(REORIENT, [*under_way, gaiting(4, gait)]) == (4, outcome)
    held = ends(REORIENT, [*under_way, gaiting(4, "stopped", Mode.HOLD)])
    assert held == (4, GoalOutcome(False, "why stopped"))
    assert ends(REORIENT, [*under_way, status(4, Mode.RELEASE)]) == (
        4,
        GoalOutcome(False, "release: because"),
    )
    late = ends(REORIENT, (gaiting(tick, "turn") for tick in range(1, 30_010)))
    assert late == (30_001, GoalOutcome(False, "not within 300 s (manipulate: because)", must_hold=True))


def test_a_release_ends_in_ready_and_a_grasp_that_touches_nothing_late_and_without_a_hold() -> None:
    opening = [status(1, Mode.RELEASE), status(2, Mode.READY)]
    assert ends(RULES.release(0.0), opening) == (2, GoalOutcome(True))
    waiting = (status(tick, Mode.READY) for tick in range(1, 2000))
    assert ends(RULES.grasp(0.0), waiting) == (1001, GoalOutcome(False, "not within 10 s (ready: because)"))


def test_a_zero_takes_the_default() -> None:
    turn = RULES.turn((0.0, 0.0, 0.5), 0.0, 0.0, 0.0)
    assert (turn.command.ramp_s, turn.timeout_s) == (None, 18.0)
    assert RULES.turn((0.0, 0.0, 0.5), 5.0, 0.0, 0.0).timeout_s == 20.0
    for error_deg, is_reached in ((math.degrees(0.0199), True), (math.degrees(0.0201), False)):
        ticks = (status(tick, error_deg=error_deg) for tick in range(1, 100))
        assert (ends(fresh(tolerance_rad=0.0), ticks) is not None) == is_reached


@pytest.mark.parametrize("field", ["duration", "tolerance", "timeout"])
@pytest.mark.parametrize("value", [-0.1, math.nan, math.inf])
def test_a_value_out_of_range_is_refused_by_name(field: str, value: float) -> None:
    unit = "rad" if field == "tolerance" else "s"
    with pytest.raises(CommandError, match=f"{field} = {value:g} is not within 0 and"):
        fresh(**{f"{field}_{unit}": value})


def test_feedback_is_in_rad_and_m_and_unknown_values_are_nan() -> None:
    known = values_of(status(1, error_deg=180.0, place_error_mm=2.0))
    assert (known["orientation_error"], known["position_error"]) == pytest.approx((math.pi, 0.002))
    unknown = values_of(status(1, error_deg=None))
    assert math.isnan(unknown["orientation_error"]) and math.isnan(unknown["position_error"])
