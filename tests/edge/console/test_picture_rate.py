"""The console gets at most ten of a camera's frames a second, evenly spaced."""

from __future__ import annotations

import random
from itertools import pairwise

import pytest

from palpate_edge.daemon.watching.view_tap import PictureRate

SECONDS = 20


@pytest.mark.parametrize(
    ("fps", "shown"), [(5, 5), (10, 10), (15, 7.5), (25, 8.4), (30, 10), (60, 10), (90, 10)]
)
def test_pictures_a_second(fps, shown):
    """25 frames/s give each third or second frame: between 8.3 and 10."""
    rate, chance = PictureRate(), random.Random(0)
    times_us = [
        round(1e6 * number / fps + chance.uniform(-2000, 2000)) + 10**12 for number in range(SECONDS * fps)
    ]
    taken = [at for at in times_us if rate.takes(at)]
    assert shown * 0.95 <= len(taken) / SECONDS <= 10.1
    if fps >= 30:
        gaps_us = [after - before for before, after in pairwise(taken)]
        assert max(gaps_us) < 150_000


def test_a_pause_and_a_clock_that_steps_back_are_no_end():
    rate = PictureRate()
    assert rate.takes(10**12)
    assert not rate.takes(10**12 + 50_000)
    assert rate.takes(10**12 + 60_000_000)
    assert rate.takes(10**12)
