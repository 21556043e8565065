"""Times at which the demo commands its turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from palpate_host.common.mode import Mode
from palpate_host.common.rotation import from_rpy_deg
from palpate_host.common.status import matrix
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore
from palpate_twin.demo.programme import TURNS_DEG, Programme, read_commands
from palpate_twin.demo.run_folder import MODEL

SECOND_US = 1_000_000
BEGIN_US = 1_700_000_000 * SECOND_US


def command_times_s(folder, duration_s, error_deg):
    """Return the times in s at which turns are commanded. error_deg: function of the time in s."""
    still = HostCore(*load_hand(MODEL)).process(BEGIN_US, ()).status
    assert still is not None
    sent = []
    programme = Programme(sent.append, folder / "commands.jsonl", duration_s)
    times_s = []
    for tick in range(round(10 * duration_s)):
        time_s = tick / 10
        error = from_rpy_deg(error_deg(time_s), 0, 0)
        status = replace(
            still,
            time_us=BEGIN_US + round(time_s * SECOND_US),
            mode=Mode.MANIPULATE,
            R_c=matrix(np.eye(3)),
            R_d=matrix(error),
        )
        before = len(sent)
        programme.update(status)
        times_s += [time_s] * (len(sent) - before)
    assert [rotate.rpy_deg for rotate in sent] == list(TURNS_DEG[1 : len(sent) + 1])
    return times_s


def test_a_turn_every_four_seconds_and_none_that_would_not_end_in_time(tmp_path):
    assert command_times_s(tmp_path, 21.0, lambda _time_s: 0.5) == [4.0, 8.0, 12.0, 16.0]
    assert read_commands(tmp_path / "commands.jsonl") == []  # the host returned no tick


def test_a_slow_hand_gets_more_time(tmp_path):
    """The error is 5 deg until 6.5 s; later it stays above the limit, and the next turn starts after 12 s."""
    times_s = command_times_s(tmp_path, 40.0, lambda time_s: 1.0 if 6.5 <= time_s < 9.0 else 5.0)
    assert times_s == [6.5, 18.5, 30.5]
