"""One number for all lines: each of them must go on."""

from __future__ import annotations

from palpate_host.drives.az.common_rounds import CommonRounds


def test_it_grows_at_the_slowest_lines_pace() -> None:
    rounds = CommonRounds(2)
    assert [rounds.count((10 * turn, turn // 2)) for turn in range(7)] == [0, 0, 1, 1, 2, 2, 3]


def test_a_fast_line_that_stands_is_seen_at_once() -> None:
    """Ahead of the other by a thousand answers, which shall not count for it."""
    rounds = CommonRounds(2)
    rounds.count((1000, 1))
    assert [rounds.count((1000, answers)) for answers in (2, 3, 500, 2000)] == [1, 1, 1, 1]
    assert rounds.count((1001, 2001)) == 2
