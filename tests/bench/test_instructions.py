"""Counted instructions repeat, and a loop that is twice as long costs twice as many."""

from __future__ import annotations

import platform
import shutil
from pathlib import Path

import pytest
from bench.instructions import Counter, measure

pytestmark = pytest.mark.process


@pytest.mark.slow
def test_counts_repeat_and_are_proportional_to_the_work(tmp_path: Path) -> None:
    """Within 2 %, the counts' scatter by addresses and environment."""
    if shutil.which("valgrind") is None:
        pytest.skip("valgrind is missing: apt install valgrind")
    count = Counter(tmp_path).run
    nothing, loop, longer = (count("-S", "-c", f"for i in range({n}): pass") for n in (1, 500_000, 1_000_000))
    assert loop - nothing > 5_000_000
    assert longer - nothing == pytest.approx(2 * (loop - nothing), rel=0.02)


def test_a_program_that_fails_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="no such frame"):
        Counter(tmp_path).run("-c", "raise SystemExit('no such frame')")


@pytest.mark.slow
def test_the_daemon_keeps_its_budget() -> None:
    """Each part of start and frame costs at most 10 % more instructions than those that are held.

    Python alone is not palpate's and is subtracted from the starts: its own start runs the .pth files of
    whatever else the environment has.
    """
    if shutil.which("valgrind") is None:
        pytest.skip("valgrind is missing: apt install valgrind")
    if platform.machine() != "x86_64":
        pytest.skip("the held counts are those of x86-64")
    alone, *rows = measure()
    over = {}
    for row in rows:
        python = (0, 0) if row.name.startswith("a frame") else (alone.count, alone.held)
        if row.count - python[0] > 1.1 * (row.held - python[1]):
            over[row.name] = f"{row.count} of {row.held}, Python alone {python[0]} of {python[1]}"
    assert not over
