"""A live hand of 10 fingertips and 3 x 5 axes on the hub's wire: its load, and whether ticks are answered."""

from __future__ import annotations

from collections import Counter

import pytest

from kernel_guest.large_hand import (
    FINGERTIPS,
    FIRST_TIP,
    FRAMES_HZ,
    NOMINAL,
    TICK_HZ,
    TICK_US,
    answer_times_us,
    budget_percent,
)
from kernel_guest.large_hand_on_hub import LargeHandOnHub
from palpate_host.common.mode import Mode

pytestmark = pytest.mark.long


def test_a_live_hand_loads_the_bus_as_the_budget_says_and_every_tick_is_answered(tmp_path):
    """pytest -s prints the figures. The nodes take no time to process a frame: all delays are the bus's."""
    rig = LargeHandOnHub(tmp_path)
    rig.run(1.2)
    assert rig.hand.status.mode is Mode.MANIPULATE
    rig.frames.clear()
    before, bits_before = rig.hand.status, rig.hub.statistics(rig.now_us).bits
    rig.run(1.0)
    status = rig.hand.status
    percent = 100 * (rig.hub.statistics(rig.now_us).bits - bits_before) / NOMINAL
    took_us = answer_times_us(rig.frames, rig.hand.host_id)
    print(f"{len(rig.frames)} frames, hub {percent:.2f} %, budget {budget_percent():.2f} %")
    print(f"answers of {len(took_us)} ticks: {max(took_us)} us at the latest, of {TICK_US} us")
    assert percent == pytest.approx(budget_percent(), rel=0.05)
    assert percent <= 40.0
    assert len(took_us) == pytest.approx(TICK_HZ, abs=1)
    assert max(took_us) < TICK_US
    assert status.mode is Mode.MANIPULATE
    assert status.counters.ticks - before.counters.ticks == TICK_HZ
    assert status.counters.late_ticks == 0
    contacts = Counter(one.frame.can_id for one in rig.frames if one.frame.can_id & 0x780 == 0x400)
    assert contacts == dict.fromkeys((0x400 + FIRST_TIP + place for place in range(FINGERTIPS)), FRAMES_HZ)
    for finger, earlier in zip(status.fingers, before.fingers, strict=True):
        assert finger.complete - earlier.complete == FRAMES_HZ
        assert (finger.incomplete, finger.late, finger.lost_frames) == (0, 0, 0)
        assert finger.unpaired == earlier.unpaired
    assert {joint.drive_state for joint in status.joints} == {"operation enabled"}
