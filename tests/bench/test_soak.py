"""A short run of `python -m bench.soak`: the loop continues, and memory does not grow."""

from __future__ import annotations

import pytest
from bench.soak_virtual import minutes

WINDOWS, WARM_UP = 9, 3
WINDOW_S = 5.0
MOST_GROWTH_BYTES = 2_000_000  # in 30 s: 700 bytes per tick, less than one stored status per tick


@pytest.mark.slow
def test_memory_does_not_grow_while_the_hand_turns_the_object():
    windows = list(minutes(WINDOW_S * WINDOWS, every_s=WINDOW_S))
    assert len(windows) == WINDOWS
    assert {window.mode for window in windows[1:]} == {"manipulate"}
    assert windows[-1].resident_bytes - windows[WARM_UP - 1].resident_bytes < MOST_GROWTH_BYTES
    frames = [window.bus_frames for window in windows[WARM_UP:]]
    assert max(frames) - min(frames) < 0.01 * min(frames)
