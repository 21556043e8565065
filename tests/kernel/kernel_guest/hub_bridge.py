"""A bridge between vcan0 and the local hub: a program that knows SocketCAN alone is on the bus of the hub."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import pytest

from kernel_guest.links import Link
from palpate_bus.hub.server import Hub
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus

BITRATE, QUEUE = 1_000_000, 1024
WAIT_S = 0.05


@dataclass(frozen=True, slots=True)
class OwnBus:
    """The bus of palpate's own programs, by the keys of [bus]."""

    interface: str
    channel: str

    @property
    def config(self) -> BusConfig:
        return BusConfig(interface=self.interface, channel=self.channel)


class Forwarder(threading.Thread):
    """Sends each frame that `source` receives to `target`; a bus does not receive its own frames."""

    def __init__(self, source: Bus, target: Bus) -> None:
        super().__init__()
        self._source, self._target = source, target
        self._ends = threading.Event()

    def run(self) -> None:
        while not self._ends.is_set():
            self._target.send(frame for _, frame in self._source.receive(WAIT_S))

    def stop(self) -> None:
        """Forward no more."""
        self._ends.set()
        self.join()


@pytest.fixture(params=["vcan", "hub"])
def own_bus(request: pytest.FixtureRequest, vcan: Link, tmp_path: Path) -> Iterator[OwnBus]:
    """vcan0 itself, or a hub that is bridged with it."""
    if request.param == "vcan":
        yield OwnBus("socketcan", vcan.name)
        return
    path = tmp_path / "hub"
    on_hub = OwnBus("palpate", str(path))
    hub = Hub(path, BITRATE, QUEUE)
    thread = threading.Thread(target=hub.run)
    thread.start()
    with ExitStack() as stack:
        stack.callback(hub.close)
        stack.callback(thread.join)
        stack.callback(hub.stop)
        buses = [
            stack.enter_context(open_bus(config, "bridge"))
            for config in (on_hub.config, BusConfig(interface="socketcan", channel=vcan.name))
        ]
        for source, target in (buses, reversed(buses)):
            forwarder = Forwarder(source, target)
            forwarder.start()
            stack.callback(forwarder.stop)
        yield on_hub
