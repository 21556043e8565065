"""Cuts are drawn from the record of an update, and each state that no board may have is a fault."""

from __future__ import annotations

from typing import Any

import pytest

from deploy_rig.power_cuts import drawn, fault
from deploy_rig.write_log import FLUSH, Entry

WHOLE = {"old": "1a", "new": "2b"}
CARD = {"current": "new", "previous": "old", "complete": True, "trial": False, "digest": "2b"}
SERVED = {**CARD, "running": "new", "rmem_max": 1 << 20, "contact_s": 70.0, "waited_s": 20.0}
# 100 writes of two blocks; every tenth entry is a flush.
ENTRIES = [Entry(0, 0 if number % 10 == 9 else 8192, FLUSH * (number % 10 == 9), 0) for number in range(100)]


def test_cuts_are_in_order_and_lose_only_what_no_flush_has_stored() -> None:
    cuts = drawn(ENTRIES, 20, 200, seed=1)
    places = [cut.before for cut in cuts]
    assert places == sorted(places)
    assert min(places) >= 20
    assert max(places) <= len(ENTRIES)
    for cut in cuts:
        flushed = max(number for number in range(cut.before) if number % 10 == 9)
        assert all(flushed < number < cut.before and block in (0, 1) for number, block in cut.lost)
    losing = sum(bool(cut.lost) for cut in cuts)
    assert 50 < losing <= 100  # a cut right after a flush has nothing to lose


def test_a_seed_draws_the_same_cuts_again() -> None:
    assert drawn(ENTRIES, 20, 50, seed=2) == drawn(ENTRIES, 20, 50, seed=2)
    assert drawn(ENTRIES, 20, 50, seed=2) != drawn(ENTRIES, 20, 50, seed=3)


@pytest.mark.parametrize("seen", [CARD, {**CARD, "previous": ""}, SERVED])
def test_one_whole_release_is_no_fault(seen: dict[str, Any]) -> None:
    assert fault(seen, WHOLE) == ""


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"current": "third"}, "third is active"),
        ({"current": "old"}, "not whole"),
        ({"digest": "2c"}, "not whole"),
        ({"complete": False}, "not whole"),
        ({"previous": "new"}, "previous is current"),
        ({"trial": True}, "trial"),
        ({"running": "old"}, "old runs"),
        ({"rmem_max": 212992}, "rmem_max"),
        ({"contact_s": 81.0}, "contact after 61 s"),
        ({"fault": "Kernel panic"}, "Kernel panic"),
    ],
)
def test_every_other_state_is_a_fault(change: dict[str, Any], text: str) -> None:
    assert text in fault({**SERVED, **change}, WHOLE)
