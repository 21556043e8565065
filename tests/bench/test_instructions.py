"""Counted instructions repeat, and a loop that is twice as long costs twice as many."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from bench.instructions import Counter

pytestmark = pytest.mark.process


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
