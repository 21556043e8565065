"""The daemon's light keeper with the real firmware on simulated wires."""

from __future__ import annotations

import errno
import random

import pytest
from firmware_rig.simulated_controller import CLOCK_HZ, SimulatedController
from firmware_rig.smbus_adapter import WireSmBus

from palpate_edge.common.errors import IlluminationError
from palpate_edge.daemon.health_report import light_health
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.controller_thread import LightController
from palpate_edge.illumination.registers import Fault

HOT_ADC = 128  # 76 degC
MS = CLOCK_HZ // 1000  # cycles


class Cable(WireSmBus):
    """Wires that can be pulled."""

    def __init__(self, controller: SimulatedController) -> None:
        super().__init__(controller)
        self.pulled = False

    def read_word_data(self, i2c_addr: int, register: int) -> int:
        self._check()
        return super().read_word_data(i2c_addr, register)

    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None:
        self._check()
        super().write_word_data(i2c_addr, register, value)

    def _check(self) -> None:
        if self.pulled:
            raise OSError(errno.ENXIO, "No such device or address")


@pytest.fixture
def cable(controller: SimulatedController) -> Cable:
    return Cable(controller)


@pytest.fixture
def light(cable: Cable) -> LightController:
    return LightController(lambda: IlluminationClient(cable, "simulated wires"), 200)


def test_the_level_reaches_the_leds_and_is_read_back(
    light: LightController, controller: SimulatedController
) -> None:
    light.update()
    controller.run_ms(250)
    light.update()
    assert controller.led_share(10) == pytest.approx((200 / 255) ** 2, abs=0.005)
    assert light.latest.level == pytest.approx(200, abs=1)
    assert light.latest.temperature_degC == pytest.approx(25.0, abs=0.3)
    light.level = 0
    light.update()
    controller.run_ms(5)
    assert controller.led_share(5) == 0.0


def test_it_stays_lit_by_the_turns_alone(light: LightController, controller: SimulatedController) -> None:
    for _ in range(8):
        controller.run_ms(250)
        light.update()
    assert controller.led_share(10) > 0.5


def test_after_a_silence_the_light_comes_back(
    light: LightController, controller: SimulatedController
) -> None:
    controller.run_ms(1500)
    assert controller.led_share(10) == 0.0
    light.update()
    light.update()
    controller.run_ms(250)
    assert controller.led_share(10) > 0.5


def test_heat_is_told(light: LightController, controller: SimulatedController) -> None:
    controller.set_adc(0, HOT_ADC)
    controller.run_ms(250)
    light.update()
    assert light.latest.too_hot
    assert light.latest.level == 0
    assert light_health(light.latest).faults == "over temperature"


def test_a_pulled_cable_is_told_and_mended(light: LightController, cable: Cable) -> None:
    cable.pulled = True
    light.update()
    assert light.latest.state is None
    assert "LEVEL" in light.latest.problem or "No such device" in light.latest.problem
    cable.pulled = False
    light.update()
    assert light.latest.problem == ""


def test_no_controller_at_the_start_is_refused(cable: Cable) -> None:
    cable.pulled = True
    with pytest.raises(IlluminationError, match="check power and wiring"):
        LightController(lambda: IlluminationClient(cable, "simulated wires"), 200)


def test_a_reset_controller_is_lit_again(light: LightController, controller: SimulatedController) -> None:
    controller.brown_out()
    controller.run_ms(20)
    light.update()
    controller.run_ms(250)
    light.update()
    controller.run_ms(250)
    assert controller.led_share(10) > 0.5


def dark_ms_after_glitches(light: LightController, controller: SimulatedController, seed: int) -> int:
    """How long the LEDs stay dark after 0.4 s of random states on every input, while the board polls."""
    rng = random.Random(seed)
    controller.disturb(rng, 400)
    end = controller.cycle + 400 * MS
    while controller.cycle < end:
        light.update()
        controller.run_ms(rng.randrange(50))
    dark_ms = round((controller.cycle - end) / MS)  # of an update that began before the end
    for _ in range(40):
        light.update()
        for _ in range(25):
            if controller.led_share(10) > 0.3:
                return dark_ms
            dark_ms += 10
    return dark_ms


@pytest.mark.parametrize("seed", range(3))
def test_glitches_on_every_input_leave_it_dark_for_less_than_a_second(
    light: LightController, controller: SimulatedController, seed: int
) -> None:
    assert dark_ms_after_glitches(light, controller, seed) < 1000


@pytest.mark.slow
def test_thirty_seeds_of_glitches_leave_it_dark_for_less_than_a_second(
    light: LightController, controller: SimulatedController
) -> None:
    dark_ms = [dark_ms_after_glitches(light, controller, seed) for seed in range(30)]
    print(f"dark for at most {max(dark_ms)} ms after the glitches, {sum(dark_ms) / 30:.0f} ms on average")
    assert max(dark_ms) < 1000


def test_the_silicones_temperature_is_back_after_a_glitch(
    light: LightController, controller: SimulatedController
) -> None:
    controller.set_adc(1, 0)
    controller.run_ms(200)
    light.update()
    assert light.latest.temperature_degC is None
    controller.set_adc(1, 512)
    controller.run_ms(200)
    light.update()
    assert light.latest.temperature_degC == pytest.approx(25.0, abs=0.3)
    assert light_health(light.latest).faults == "silicone sensor"


def shares_of_ten_seconds(light: LightController, controller: SimulatedController) -> list[float]:
    """What the LEDs got at the end of each turn of 250 ms."""
    shares = []
    for _ in range(42):
        light.update()
        controller.run_ms(245)
        shares.append(controller.led_share(5))
    return shares


@pytest.mark.slow
def test_it_blinks_for_ten_seconds_and_is_lit_as_before(
    light: LightController, controller: SimulatedController
) -> None:
    light.blink()
    shares = shares_of_ten_seconds(light, controller)
    assert [share > 0.9 for share in shares[:40]] == [True, False] * 20
    assert {round(share, 2) for share in shares[1:40:2]} == {0.0}
    assert shares[-1] == pytest.approx((200 / 255) ** 2, abs=0.01)
    light.update()
    assert light.latest.state is not None
    assert Fault.BOARD_SILENT not in light.latest.state.faults
