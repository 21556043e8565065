"""The budget of a large hand on CAN FD against what the hub measures."""

from __future__ import annotations

from collections import defaultdict, deque

import pytest

from kernel_guest.fd_traffic import AXES, DRIVES, FINGERTIPS, FRAMES_HZ, HOST, TICK_HZ, large_hand
from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import Hello
from palpate_bus.load.budget import BudgetCase, budget

CASE = BudgetCase(
    fingertips=len(FINGERTIPS),
    joints=len(DRIVES),
    frames_per_s=FRAMES_HZ,
    tick_Hz=TICK_HZ,
    data_bitrate=5_000_000,
)


@pytest.mark.parametrize("axes", [False, True], ids=["a node each", "5 axes a node"])
def test_the_budget_of_a_large_hand_is_what_the_hub_measures_and_no_frame_waits_for_a_tick(axes):
    """pytest -s prints the loads and the longest wait."""
    expected = budget(CASE.sharing_nodes(AXES) if axes else CASE)
    (contact,) = [stream.length for stream in expected.streams if stream.name == "fingertip TPDO 10"]
    hub = HubCore(CASE.bitrate, 128, 0, CASE.data_bitrate)
    clients = {}
    for node in (*FINGERTIPS, *DRIVES, HOST):
        clients[node] = Client()
        hub.receive(clients[node], protocol.hello_message(Hello(f"n{node}", 0, False, False, 0)), 0)
    queued_at: dict[int, deque[int]] = defaultdict(deque)
    waits, delivered = [], []

    def carry(now_us: int) -> None:
        for delivery in hub.advance(now_us):
            can_id = delivery.frame.can_id
            wait_us = delivery.won_at_us - queued_at[can_id].popleft()
            if can_id < 0x580:  # SYNC and PDOs; SDO and heartbeats have no deadline within a tick
                waits.append(wait_us)
            delivered.append(delivery.frame)

    traffic = large_hand(contact, axes=axes)
    for at_us, node, frame in traffic:
        carry(at_us)
        hub.receive(clients[node], protocol.send_messages([frame]), at_us)
        queued_at[frame.can_id].append(at_us)
    carry(2_000_000)
    assert len(delivered) == len(traffic)
    measured_percent = 100 * hub.statistics(1_000_000).bits / CASE.bitrate
    print(f"hub {measured_percent:.2f} %, budget {expected.mean_percent:.2f} %, longest wait {max(waits)} us")
    assert measured_percent == pytest.approx(expected.mean_percent, rel=0.05)
    assert max(waits) < 1_000_000 / TICK_HZ
    assert not axes or measured_percent <= 40.0  # what the drives' frames were put together for
