"""The live large hand on the hub's wire, in virtual time."""

from __future__ import annotations

from pathlib import Path

from kernel_guest.large_hand import DATA, NOMINAL, LiveHand, OnBus, large_hand
from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import Hello
from palpate_host.network.nmt_master import SYNC

START_US = 1_700_000_000_000_000


class LargeHandOnHub:
    """A `LiveHand` whose nodes are clients of a hub, in virtual time. frames: as they were received."""

    def __init__(self, folder: Path) -> None:
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
