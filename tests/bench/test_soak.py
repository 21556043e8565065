"""The hour of `python -m bench.soak`, for a minute or less: the loop goes on, and nothing piles up."""

from __future__ import annotations

from bench.soak_virtual import minutes

WINDOWS, WARM_UP = 9, 3
REDUCED_S, FULL_S = 2, 5  # a window
MOST_GROWTH_BYTES = 2_000_000  # in 30 s: 700 bytes a tick; one status kept of each would be more


def test_nothing_piles_up_while_the_hand_turns_the_object(effort):
    window_s = float(effort(REDUCED_S, FULL_S))
    seen = list(minutes(window_s * WINDOWS, every_s=window_s))
    assert len(seen) == WINDOWS
    assert {window.mode for window in seen[1:]} == {"manipulate"}
    assert seen[-1].resident_bytes - seen[WARM_UP - 1].resident_bytes < MOST_GROWTH_BYTES
    frames = [window.bus_frames for window in seen[WARM_UP:]]
    assert max(frames) - min(frames) < 0.01 * min(frames)
