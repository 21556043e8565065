"""A turn by finger gaiting from request to end, on a cube between four ideal fingers."""

import math
from itertools import product

import numpy as np
import pytest
from tests.host.control.gait.ideal_reach import HALF_M, OUT, PLACE_M, RADIUS_M
from tests.host.control.gait.test_gait_in_closed_form import GAINS, PLAN, Walk

from palpate_host.common import rotation
from palpate_host.common.command import CommandError
from palpate_host.common.gait_plan import GaitRefusal, GaitRefusedError
from palpate_host.control.gait.gait import GaitPhase
from palpate_host.control.gait.reorientation import Reorientation

CUBE_MM = tuple(tuple(1e3 * (PLACE_M + HALF_M * np.array(signs))) for signs in product((-1, 1), repeat=3))
QUARTER = (0.0, 0.0, 90.0)


class Held:
    """A reorientation with the law and the pose of a hold."""

    def __init__(self):
        walk = Walk()
        self.law, self.pose, self.turn = walk.law, walk.pose(), Reorientation()
        self.law.follow_point = self._follow

    def _follow(self, place_m):
        self.law.object.place_m = place_m

    def ask(self, rpy_deg=QUARTER, corners_mm=CUBE_MM):
        self.turn.ask(self.law, self.pose, GAINS, rpy_deg, corners_mm)
        return self.turn.request

    def planned(self):
        self.ask()
        self.turn.take_plan(self.law, GAINS, PLAN, "")
        return self.turn.gait


def test_a_request_has_what_the_planner_needs():
    held = Held()
    turned = rotation.from_rpy_deg(0.0, 0.0, 30.0)
    held.law.object.R = turned
    request = held.ask((0.0, 60.0, 0.0))
    np.testing.assert_allclose(request.axis, [0.0, 1.0, 0.0], atol=1e-12)
    assert request.angle_rad == pytest.approx(math.radians(60.0))
    np.testing.assert_allclose(request.place_m, PLACE_M, atol=1e-12)
    np.testing.assert_array_equal(request.R, turned)
    assert request.depth_m == pytest.approx(RADIUS_M - 0.027)
    in_hand = request.shape.moved(turned, PLACE_M)
    np.testing.assert_allclose(in_hand.gap_m(held.pose.tip_centre_m), 0.027, atol=1e-12)
    assert held.turn.is_under_way and held.turn.lifted is None


@pytest.mark.parametrize(
    ("asked", "reason"),
    [
        ({"rpy_deg": (0.0, 0.0, 0.01)}, "a turn of 0 deg"),
        ({"corners_mm": CUBE_MM[:4]}, "the corners enclose no volume"),
        (
            {"corners_mm": tuple((x + 6.0, y, z) for x, y, z in CUBE_MM)},
            r"finger [13] is -?6.0 mm from the object",
        ),
    ],
)
def test_a_request_that_cannot_be_is_refused_and_changes_nothing(asked, reason):
    held = Held()
    with pytest.raises(CommandError, match=reason):
        held.ask(**asked)
    assert not held.turn.is_under_way
    held.ask(corners_mm=tuple((x + 4.0, y, z) for x, y, z in CUBE_MM))  # within 5 mm


def test_three_fingers_are_too_few():
    held = Held()
    held.law.object.set_radius(np.full(3, 0.027))
    with pytest.raises(GaitRefusedError, match="a hand of 3 fingers") as refused:
        held.ask()
    assert refused.value.reason is GaitRefusal.FINGERS


def test_while_a_turn_is_under_way_another_command_is_refused():
    held = Held()
    held.ask()
    with pytest.raises(CommandError, match="move is refused: a turn by finger gaiting is under way"):
        held.turn.check_free("move")
    held.turn.take_plan(held.law, GAINS, PLAN, "")
    assert held.turn.is_under_way and held.turn.request is None
    with pytest.raises(CommandError, match="is under way"):
        held.ask()
    held.turn.gait.away = 2
    held.turn.gait.phase = GaitPhase.STOPPED
    assert not held.turn.is_under_way
    with pytest.raises(CommandError, match="move is refused: finger 3 is lifted; grasp first"):
        held.turn.check_free("move")
    held.turn.gait.away = None
    held.turn.check_free("move")


@pytest.mark.parametrize(
    ("moved_mm", "turned_deg", "problem"),
    [
        (1.9, 1.9, ""),
        (2.1, 0.0, "the object moved by 2.1 mm and 0.0 deg while it was planned"),
        (0.0, 2.1, "the object moved by 0.0 mm and 2.1 deg while it was planned"),
    ],
)
def test_a_plan_fits_an_object_that_has_hardly_moved(moved_mm, turned_deg, problem):
    held = Held()
    held.ask()
    held.law.object.place_m = PLACE_M + np.array([0.0, 1e-3 * moved_mm, 0.0])
    held.law.object.R = rotation.from_rpy_deg(turned_deg, 0.0, 0.0)
    held.turn.take_plan(held.law, GAINS, PLAN, "")
    assert (held.turn.gait is None) is bool(problem)
    assert problem in held.turn.problem and held.turn.request is None


def test_a_plan_without_a_request_or_an_object_is_left():
    held = Held()
    held.turn.take_plan(held.law, GAINS, PLAN, "")
    assert held.turn.gait is None
    held.ask()
    held.law.object = None
    held.turn.take_plan(held.law, GAINS, PLAN, "")
    assert held.turn.gait is None and held.turn.request is None


def test_a_refused_plan_leaves_its_reason_until_the_next_request():
    held = Held()
    held.ask()
    held.turn.take_plan(held.law, GAINS, None, "no place in reach")
    assert (held.turn.problem, held.turn.is_under_way) == ("no place in reach", False)
    held.ask()
    assert held.turn.problem == ""


def test_giving_up_ends_a_request_and_stops_a_gait_once():
    held = Held()
    held.turn.give_up(held.law, "why")
    assert held.turn.problem == ""
    held.ask()
    held.turn.give_up(held.law, "why")
    assert (held.turn.request, held.turn.problem) == (None, "the turn is refused: why")
    gait = held.planned()
    held.turn.give_up(held.law, "why")
    assert (gait.phase, gait.reason) == (GaitPhase.STOPPED, "gait stopped: why")
    held.turn.give_up(held.law, "again")
    assert gait.reason == "gait stopped: why"
    assert len(OUT) == len(PLAN.normals)
    held.turn.end("the hold ended")
    assert (held.turn.gait, held.turn.lifted, held.turn.problem) == (None, None, "the hold ended")
