"""The console's LED level and blinking, with the real firmware on simulated wires and no daemon."""

from __future__ import annotations

import time
from contextlib import closing
from pathlib import Path

import pytest
from firmware_rig.simulated_controller import SimulatedController
from firmware_rig.smbus_adapter import WireSmBus

from palpate_edge.console.camera_feed import CameraFeed
from palpate_edge.console.events import ConsoleHealth
from palpate_edge.console.feed import NewestPicture
from palpate_edge.daemon.config import read_config
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.web.broadcast import Broadcast

PATIENCE_S = 60.0


class NotedHealth(Broadcast):
    """A broadcast that keeps the health of a page."""

    health: ConsoleHealth | None = None

    def publish(self, kind: str, value: object) -> None:
        if isinstance(value, ConsoleHealth):
            self.health = value
        super().publish(kind, value)


def test_the_level_reaches_the_leds_and_comes_with_the_health(
    tmp_path: Path, drawn_dataset: Path, controller: SimulatedController, monkeypatch: pytest.MonkeyPatch
) -> None:
    levels: list[int] = []

    class NotedClient(IlluminationClient):
        def set_level(self, level: int) -> None:
            levels.append(level)
            super().set_level(level)

    monkeypatch.setattr(
        IlluminationClient, "open", lambda _bus, _address: NotedClient(WireSmBus(controller), "wires")
    )
    config = tmp_path / "finger.toml"
    config.write_text(
        f'name = "lit"\n[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\nloop = true\n'
        '[node]\nid = 16\n[bus]\ninterface = "palpate"\n[illumination]\ni2c_bus = 3\n'
    )
    broadcast = NotedHealth()

    def shown_level() -> int | None:
        return broadcast.health and broadcast.health.light and broadcast.health.light.level

    def until_shown(level: int) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while (shown := shown_level()) is None or abs(shown - level) > 2:  # the controller's duty has steps
            assert time.monotonic() < end_s, (shown, levels)
            time.sleep(0.02)

    with closing(CameraFeed(read_config(config), print, broadcast, NewestPicture(), 640)) as feed:
        until_shown(255)
        assert feed.execute("light", 90) == "LED level 90"
        until_shown(90)
        assert feed.execute("identify", 0) == "the LED ring blinks for 10 s"
        end_s = time.monotonic() + PATIENCE_S
        while levels[-3:] not in ([255, 0, 255], [0, 255, 0]):
            assert time.monotonic() < end_s, levels
            time.sleep(0.02)
