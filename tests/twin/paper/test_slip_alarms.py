"""The fingertip's own slip detector in random handling: no false alarm."""

import pytest
from bench.slip_alarms import run


@pytest.mark.slow
def test_random_handling_gives_no_false_alarm():
    """Two of the 60 minutes of docs/holding.md."""
    assert sum(run(number).false_flags for number in range(24)) == 0
