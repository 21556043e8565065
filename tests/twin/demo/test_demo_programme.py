"""When the demo asks for its turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate_host.common.mode import Mode
from palpate_host.common.rotation import from_rpy_deg
from palpate_host.common.status import matrix
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore
from palpate_twin.demo.programme import TURNS_DEG, Programme, read_given
from palpate_twin.demo.run_folder import MODEL

SECOND_US = 1_000_000
BEGIN_US = 1_700_000_000 * SECOND_US


def asked_at_s(folder, duration_s, missing_deg):
    """Seconds of turning at which turns are asked for; missing_deg: of the time, as the host feels it."""
    still = HostCore(*load_hand(MODEL)).process(BEGIN_US, ()).status
    assert still is not None
    given = []
    programme = Programme(given.append, folder / "given.jsonl", duration_s)
    times_s = []
    for tick in range(round(10 * duration_s)):
        time_s = tick / 10
        missing = from_rpy_deg(missing_deg(time_s), 0, 0)
        status = replace(
            still,
            time_us=BEGIN_US + round(time_s * SECOND_US),
            mode=Mode.MANIPULATE,
            R_c=matrix(np.eye(3)),
            R_d=matrix(missing),
        )
        before = len(given)
        programme.look(status)
        times_s += [time_s] * (len(given) - before)
    assert [rotate.rpy_deg for rotate in given] == list(TURNS_DEG[1 : len(given) + 1])
    return times_s


def test_a_turn_every_four_seconds_and_none_that_would_not_be_over(tmp_path):
    assert asked_at_s(tmp_path, 21.0, lambda _time_s: 0.5) == [4.0, 8.0, 12.0, 16.0]
    assert read_given(tmp_path / "given.jsonl") == []  # nothing was answered


def test_a_hand_that_is_slow_gets_its_time(tmp_path):
    """It misses 5 deg until 6.5 s; later it never arrives, and is waited for no longer than 12 s."""
    missing = asked_at_s(tmp_path, 40.0, lambda time_s: 1.0 if 6.5 <= time_s < 9.0 else 5.0)
    assert missing == [6.5, 18.5, 30.5]
