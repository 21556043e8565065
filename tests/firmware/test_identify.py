"""`palpate-edge identify` with the real firmware on simulated wires, beside a running fingertip and alone."""

from __future__ import annotations

import os
import time
from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner, Result
from firmware_rig.simulated_controller import SimulatedController
from firmware_rig.smbus_adapter import WireSmBus
from tests.health_of_a_fingertip import REPORT as HEALTHY

from palpate_edge.cli.identify import identify
from palpate_edge.common.errors import IlluminationError
from palpate_edge.common.signals import IDENTIFY, called_by_signals
from palpate_edge.daemon.health import write_health
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.controller_thread import LightController


class Ring:
    """A fingertip's file, and the controller of its LED ring as /dev/i2c-3 would give it."""

    def __init__(
        self, folder: Path, controller: SimulatedController, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        self.folder, self._controller = folder, controller
        self.shares: list[float] = []
        monkeypatch.setattr(IlluminationClient, "open", lambda _bus, _address: self.opened())
        monkeypatch.setattr(time, "sleep", self._sleep)

    def opened(self) -> IlluminationClient:
        return IlluminationClient(WireSmBus(self._controller), "simulated wires")

    def _sleep(self, seconds: float) -> None:
        """Of the controller's own time; what the LEDs get at the end is kept."""
        self._controller.run_ms(round(1000 * seconds) - 5)
        self.shares.append(self._controller.led_share(5))

    def runs(self, nmt_state: str) -> None:
        """A fingertip's health file, with this process as its daemon."""
        report = msgspec.structs.replace(
            HEALTHY, pid=os.getpid(), written_at=time.monotonic(), nmt_state=nmt_state
        )
        write_health(self.folder / "health", report)

    def identify(self, illumination: str = "[illumination]\ni2c_bus = 3\n") -> Result:
        config = self.folder / "finger.toml"
        config.write_text(
            f'name = "finger"\nhealth = "{self.folder / "health"}"\n[capture]\n'
            'source = "v4l2"\npath = "/dev/video0"\n[estimator]\ncalibration = "finger.cal"\n[node]\n'
            f'id = 16\n[bus]\ninterface = "socketcan"\nchannel = "can0"\n{illumination}'
        )
        return CliRunner().invoke(identify, ["--config", str(config)])


@pytest.fixture
def ring(tmp_path: Path, controller: SimulatedController, monkeypatch: pytest.MonkeyPatch) -> Ring:
    return Ring(tmp_path, controller, monkeypatch)


def test_where_nothing_runs_it_blinks_by_itself(ring: Ring) -> None:
    answer = ring.identify()
    assert answer.exit_code == 0, answer.output
    assert [share > 0.9 for share in ring.shares] == [True, False] * 20


def test_a_fingertip_that_runs_is_told_by_a_signal(ring: Ring) -> None:
    light = LightController(ring.opened, 200)
    ring.runs("pre-operational")
    with called_by_signals({IDENTIFY: light.blink}):
        answer = ring.identify()
    assert answer.exit_code == 0, answer.output
    for _ in range(4):
        light.update()
        time.sleep(0.25)
    assert [share > 0.9 for share in ring.shares] == [True, False, True, False]


def test_a_hand_keeps_its_sight(ring: Ring) -> None:
    ring.runs("operational")
    answer = ring.identify()
    assert isinstance(answer.exception, IlluminationError)
    assert "stop the host first" in str(answer.exception)
    assert ring.shares == []


def test_a_fingertip_without_a_ring_says_so(ring: Ring) -> None:
    answer = ring.identify(illumination="")
    assert isinstance(answer.exception, IlluminationError)
    assert "has no LED ring" in str(answer.exception)
