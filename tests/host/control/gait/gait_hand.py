"""The hand of four fingers with its object, as the tests of gaiting use it."""

import math
from functools import cache

import numpy as np

from palpate_host.config.packaged import MODELS
from palpate_host.control.gait.finger_reach import FingerReach, ObjectPath
from palpate_host.control.gait.object_shape import shape_of
from palpate_host.control.gait.turn_planner import plan_turn
from palpate_host.service.host import load_hand
from palpate_twin.hand.prism import prism_of

HAND = MODELS / "table4-four.toml"
DEPTH_M = 0.003
FRICTION = 0.4


@cache
def loaded():
    return load_hand(HAND)


def reach():
    config, hand = loaded()
    return FingerReach(hand, config, DEPTH_M)


def start_rad():
    return np.tile(loaded()[0].twin.start_pose_rad, 4)


def path(axis):
    return ObjectPath(np.array(loaded()[0].twin.object.position_m), np.eye(3), np.array(axis, dtype=float))


def shape():
    return shape_of(prism_of(loaded()[0].twin.object).all_faces_m())


@cache
def planned(axis=(0.0, 0.0, 1.0), angle_deg=40.0, friction=FRICTION):
    return plan_turn(reach(), shape(), path(axis), start_rad(), math.radians(angle_deg), friction)
