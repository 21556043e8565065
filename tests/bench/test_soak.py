"""A short run of `python -m bench.soak`: the loop continues, and memory does not grow."""

from __future__ import annotations

from bench.soak_virtual import minutes

WINDOWS, WARM_UP = 9, 3
REDUCED_S, FULL_S = 2, 5  # duration of a window
MOST_GROWTH_BYTES = 2_000_000  # in 30 s: 700 bytes per tick, less than one stored status per tick


def test_memory_does_not_grow_while_the_hand_turns_the_object(effort):
    window_s = float(effort(REDUCED_S, FULL_S))
    windows = list(minutes(window_s * WINDOWS, every_s=window_s))
    assert len(windows) == WINDOWS
    assert {window.mode for window in windows[1:]} == {"manipulate"}
    assert windows[-1].resident_bytes - windows[WARM_UP - 1].resident_bytes < MOST_GROWTH_BYTES
    frames = [window.bus_frames for window in windows[WARM_UP:]]
    assert max(frames) - min(frames) < 0.01 * min(frames)
