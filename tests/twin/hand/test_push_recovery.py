"""Figures of pushes, from a motion whose distances are known."""

import math

import numpy as np
import pytest

from palpate_host.config.twin_config import DisturbanceConfig
from palpate_twin.hand.motion import TrueMotion
from palpate_twin.hand.push_recovery import push_steps

BEGIN_US = 1_700_000_000_000_000
PUSH = DisturbanceConfig(start_s=2.0, duration_s=0.2, force_N=(0.0, 0.0, -2.0))


def motion(height_m, seconds=5.0):
    """The object at the height (in m, of the time in s), every 20 ms; the log begins half a second later."""
    time_s = np.arange(0.0, seconds, 0.02)
    pose = np.zeros((len(time_s), 7))
    pose[:, 2] = [height_m(one) for one in time_s]
    none = np.zeros((len(time_s), 3))
    return TrueMotion(BEGIN_US + 1e6 * time_s, none[:, 0], none, pose, none, none, none)


def dip(time_s):
    """Down by 7 mm in the 0.2 s of the push, back within half a second but for 0.5 mm."""
    down_mm = np.interp(time_s, [2.0, 2.2, 2.7], [0.0, 7.0, 0.5])
    return 0.1 - 1e-3 * float(down_mm)


def test_an_object_that_comes_back():
    (step,) = push_steps([PUSH], motion(dip), BEGIN_US + 500_000)
    assert step.begin_s == pytest.approx(1.5)
    assert step.moved_mm == pytest.approx(7.0)
    assert step.remaining_mm == pytest.approx(0.5)
    assert step.is_held
    assert step.name == "push 2 N along -z for 0.2 s"
    assert step.outcome == "moved by 7.0 mm, back within 0.5 mm after 1 s"


def test_an_object_that_does_not_come_back():
    (step,) = push_steps([PUSH], motion(lambda time_s: 0.1 - 0.03 * (time_s >= 2.1)), BEGIN_US)
    assert not step.is_held
    assert step.outcome == "moved by 30.0 mm, NOT HELD: 30.0 mm off after 1 s (limit 2 mm)"


def test_what_is_no_push_or_is_not_over_is_left_out():
    steady = DisturbanceConfig(start_s=1.0, force_N=(0.0, 0.0, -1.0))
    slippery = DisturbanceConfig(start_s=1.0, duration_s=0.5, friction=0.3)
    assert steady.duration_s == math.inf
    assert push_steps([steady, slippery], motion(dip), BEGIN_US) == ()
    assert push_steps([PUSH], motion(dip, seconds=3.1), BEGIN_US) == ()
