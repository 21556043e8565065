"""Growth of counters within the last window, and the share of frames that it dropped."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.common.sliding_window import WINDOW_US, DroppedFrames, SlidingWindow

SECOND_US = 1_000_000
START_US = 1_700_000_000_000_000
STEP_US = st.one_of(st.integers(0, 2 * SECOND_US), st.integers(0, 2 * WINDOW_US), st.just(WINDOW_US))
GROWTH = st.tuples(st.integers(0, 3), st.integers(0, 1000))


@given(st.lists(st.tuples(STEP_US, GROWTH), min_size=1, max_size=200))
def test_as_told_from_all_looks(steps):
    window, looks = SlidingWindow(), []
    now_us, counts = START_US, (7, 0)
    for step_us, growth in steps:
        now_us += step_us
        counts = tuple(count + more for count, more in zip(counts, growth, strict=True))
        looks.append((now_us, counts))
        within = [then for at_us, then in looks if now_us - at_us <= WINDOW_US]
        assert window.growth(now_us, counts) == tuple(count - within[0][i] for i, count in enumerate(counts))


@given(st.lists(st.tuples(st.integers(-2 * WINDOW_US, 2 * WINDOW_US), GROWTH), max_size=100))
def test_a_clock_that_steps_back_makes_nothing_negative_nor_too_much(steps):
    window, now_us, count = SlidingWindow(), START_US, 0
    for step_us, (more, _) in steps:
        now_us += step_us
        count += more
        assert 0 <= window.growth(now_us, (count,))[0] <= count


def test_what_grew_before_a_jump_is_forgotten():
    window = SlidingWindow()
    assert window.growth(START_US, (5, 0)) == (0, 0)
    assert window.growth(START_US + SECOND_US, (8, 1)) == (3, 1)
    assert window.growth(START_US + 2 * SECOND_US + WINDOW_US, (9, 9)) == (0, 0)
    assert window.growth(START_US, (10, 9)) == (0, 0)
    assert window.growth(START_US + SECOND_US, (12, 9)) == (2, 0)


def test_a_counter_that_goes_back_has_not_grown():
    window = SlidingWindow()
    window.growth(START_US, (5,))
    assert window.growth(START_US + SECOND_US, (3,)) == (0,)


def shares(frames_dropped):
    """A look each second; the pairs are what each second added."""
    lately, frames, dropped = DroppedFrames(), 0, 0
    for second, (more_frames, more_dropped) in enumerate(frames_dropped):
        frames, dropped = frames + more_frames, dropped + more_dropped
        yield lately.share(START_US + second * SECOND_US, frames, dropped)


def test_what_the_start_dropped_does_not_count():
    assert set(shares([(0, 4), (1, 9), (20, 9), (30, 0), (30, 0)])) == {0.0}


def test_hours_of_good_frames_hide_nothing():
    told = list(shares([(30, 0)] * 10_000 + [(15, 15)] * 30))
    assert max(told[:10_000]) == 0.0
    assert told[-1] == pytest.approx(0.25)


def test_one_bad_second_is_over_after_a_window():
    told = list(shares([(30, 0)] * 100 + [(10, 20)] + [(30, 0)] * 100))
    assert told[100] == pytest.approx(20 / 1800, rel=0.02)
    assert told[159] == pytest.approx(20 / 1800)
    assert set(told[161:]) == {0.0}
