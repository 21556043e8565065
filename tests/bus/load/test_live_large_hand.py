"""A live hand of 10 fingertips and 3 x 5 axes on the hub's wire: its load, and whether ticks are answered."""

from __future__ import annotations

from collections import Counter

import pytest

from kernel_guest.large_hand import (
    DATA,
    FINGERTIPS,
    FIRST_TIP,
    FRAMES_HZ,
    NOMINAL,
    TICK_HZ,
    TICK_US,
    LiveHand,
    OnBus,
    answer_times_us,
    budget_percent,
    large_hand,
)
from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import Hello
from palpate_host.common.mode import Mode
from palpate_host.network.nmt_master import SYNC

START_US = 1_700_000_000_000_000

pytestmark = pytest.mark.long


class HandOnHub:
    """A `LiveHand` whose nodes are clients of a hub, in virtual time. frames: as they were received."""

    def __init__(self, folder) -> None:
        self.now_us = START_US
        self.hand = LiveHand(*large_hand(folder), START_US)
        self.hub = HubCore(NOMINAL, 128, START_US, DATA)
        self._clients = {node: Client() for node in self.hand.node_ids}
        for node, client in self._clients.items():
            hello = Hello(f"node {node}", NOMINAL, node == self.hand.host_id, False, DATA)
            self.hub.receive(client, protocol.hello_message(hello), START_US)
            assert client.has_fd
        self._node_of_port = {client.port: node for node, client in self._clients.items()}
        self.frames: list[OnBus] = []

    def run(self, duration_s: float) -> None:
        end_us = self.now_us + round(duration_s * 1e6)
        while self.now_us < end_us:
            hub_us = self.hub.next_due_us(self.now_us)
            due_us = self.hand.due_us if hub_us is None else min(hub_us, self.hand.due_us)
            self.now_us = max(self.now_us, due_us)
            received = [
                OnBus(self.now_us, self._node_of_port[delivery.sender], delivery.frame)
                for delivery in self.hub.advance(self.now_us)
            ]
            self.frames += received
            host = self.hand.host_id
            to_devices = [one.frame for one in received if one.node_id == host]
            to_host = [(one.at_us, one.frame) for one in received if one.node_id != host or one.frame == SYNC]
            for one in self.hand.step(self.now_us, to_devices, to_host):
                client = self._clients[one.node_id]
                self.hub.receive(client, protocol.send_messages([one.frame]), self.now_us)
                client.output.clear()


def test_a_live_hand_loads_the_bus_as_the_budget_says_and_every_tick_is_answered(tmp_path):
    """pytest -s prints the figures. The nodes take no time to process a frame: all delays are the bus's."""
    rig = HandOnHub(tmp_path)
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
