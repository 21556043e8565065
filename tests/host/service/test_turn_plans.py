"""Plans of large turns from a process of their own: a plan, a refusal, and requests that are dropped."""

import time
from dataclasses import replace

import numpy as np
import pytest
from tests.host.control.gait.gait_hand import loaded, shape, start_rad

from palpate_host.control.gait.turn_request import TurnRequest
from palpate_host.service.turn_plans import TurnPlans

pytestmark = [pytest.mark.process, pytest.mark.long]
TIMEOUT_S = 120.0


def request(angle_rad=0.1):
    return TurnRequest(
        q_rad=start_rad(),
        R=np.eye(3),
        place_m=np.array(loaded()[0].twin.object.position_m),
        shape=shape(),
        depth_m=0.003,
        axis=np.array([0.0, 0.0, 1.0]),
        angle_rad=angle_rad,
    )


@pytest.fixture
def plans():
    made = TurnPlans(loaded()[0])
    yield made
    made.close()


def answer(plans, asked):
    """Ask in every tick until the answer is there."""
    end_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s:
        planned = plans.update(asked)
        if planned is not None:
            return planned
        time.sleep(0.02)
    raise AssertionError("no plan in time")


def test_a_request_is_planned_without_blocking(plans):
    planned = answer(plans, request())
    assert planned.plan is not None
    assert planned.plan.angle_rad == 0.1
    assert planned.plan.regrasps == 0
    assert plans.update(None) is None


def test_a_turn_that_the_hand_cannot_is_refused_with_the_reason(plans):
    far = replace(request(3.0), place_m=np.array([0.0, 0.0, 0.5]))
    planned = answer(plans, far)
    assert planned.plan is None
    assert planned.problem.startswith("the turn is refused: at 0 deg")


def test_a_planner_that_dies_is_a_refusal_and_a_dropped_request_ends_it(plans):
    asked = request(1.5)
    assert plans.update(asked) is None
    plans._process.kill()
    assert "its planner ended without a plan" in answer(plans, asked).problem
    assert plans.update(request(1.5)) is None
    process = plans._process
    assert plans.update(None) is None
    with pytest.raises(ValueError, match="closed"):
        process.is_alive()
