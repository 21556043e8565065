"""The request for the plan of a large turn: what a planner needs, as data for another process."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_host.common.gait_plan import GaitPlan
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.gait.finger_reach import FingerReach, ObjectPath
from palpate_host.control.gait.object_shape import ObjectShape
from palpate_host.control.gait.turn_planner import plan_turn
from palpate_host.control.kinematics import HandKinematics


@dataclass(frozen=True, slots=True)
class TurnRequest:
    """A turn by angle_rad about axis (3,) of the hand, from the grasp with the joints q_rad (nq,).

    R (3, 3), place_m (3,): the object's pose in the hand's frame. shape: in the object's frame, its origin at
    the place. depth_m: mean indentation of the tips.
    """

    q_rad: Array
    R: Array
    place_m: Array
    shape: ObjectShape
    depth_m: float
    axis: Array
    angle_rad: float


def plan_of(request: TurnRequest, hand: HandKinematics, config: HandConfig) -> GaitPlan:
    """Return the plan of a request. Raises GaitRefusedError when the hand cannot."""
    return plan_turn(
        FingerReach(hand, config, request.depth_m),
        request.shape,
        ObjectPath(request.place_m, request.R, request.axis),
        np.array(request.q_rad),
        request.angle_rad,
        config.pose_law.friction,
    )
