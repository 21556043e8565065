"""The real binary on a simulated ATmega328P, by its pins alone; the client of the board on top of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from firmware_rig.simulated_controller import CLOCK_HZ, SimulatedController
from firmware_rig.smbus_adapter import WireSmBus

from palpate_edge.errors import IlluminationError
from palpate_edge.illumination import Illumination
from palpate_edge.illumination_registers import I2C_ADDRESS, Fault, Register

ROOM_ADC, HOT_ADC = 512, 128  # 25 and 76 degC by the B equation


@pytest.fixture
def bus(controller: SimulatedController) -> WireSmBus:
    return WireSmBus(controller)


@pytest.fixture
def client(bus: WireSmBus) -> Illumination:
    return Illumination(bus, "simulated wires")


def test_size_and_stack_are_within_their_budgets(build: Path) -> None:
    text = (build / "budget.txt").read_text()
    print(text)
    assert "flash" in text


def test_nobody_at_another_address(bus: WireSmBus) -> None:
    with pytest.raises(OSError, match="Remote I/O"):
        bus.read_word_data(I2C_ADDRESS + 1, Register.IDENTITY)


def test_client_sets_the_level_and_the_pwm_follows(
    client: Illumination, controller: SimulatedController
) -> None:
    assert controller.led_share(10) == 0.0
    client.set_level(128)
    controller.run_ms(250)
    assert controller.led_share(10) == pytest.approx((128 / 255) ** 2, abs=0.005)
    client.set_level(255)
    controller.run_ms(250)
    assert controller.led_share(10) == pytest.approx(1.0, abs=0.002)
    client.set_level(0)
    controller.run_ms(2)
    assert controller.led_share(10) == 0.0


def test_client_reads_temperatures(client: Illumination, controller: SimulatedController) -> None:
    controller.set_adc(0, 256)  # 10 kOhm to a third of it: 52.0 degC by the B equation
    controller.set_adc(1, ROOM_ADC)
    controller.run_ms(20)
    state = client.state()
    assert state.led_degC == pytest.approx(52.0, abs=0.5)
    assert state.silicone_degC == pytest.approx(25.0, abs=0.3)
    assert state.faults == Fault(0)


def test_client_refuses_out_of_range_before_the_wire(client: Illumination) -> None:
    with pytest.raises(IlluminationError, match="LEVEL 256 is not 0 to 255"):
        client.set_level(256)


def test_out_of_range_on_the_wire_is_not_acknowledged(bus: WireSmBus) -> None:
    with pytest.raises(OSError, match="Remote I/O"):
        bus.write_word_data(I2C_ADDRESS, Register.LEVEL, 256)
    assert bus.read_word_data(I2C_ADDRESS, Register.LEVEL) == 0


def test_silence_of_the_board_darkens(client: Illumination, controller: SimulatedController) -> None:
    client.write(Register.WATCHDOG, 100)
    client.set_level(200)
    controller.run_ms(150)
    assert controller.led_share(10) == 0.0
    assert client.state().faults == Fault.BOARD_SILENT
    client.clear(Fault.BOARD_SILENT)
    assert client.state().faults == Fault(0)


def test_heat_darkens_without_the_board(client: Illumination, controller: SimulatedController) -> None:
    client.set_level(255)
    controller.run_ms(250)
    controller.set_adc(0, HOT_ADC)
    controller.run_ms(20)  # each thermistor has its turn every 8 ms
    assert controller.led_share(5) == 0.0
    assert Fault.OVER_TEMPERATURE in client.state().faults


def test_flash_follows_the_trigger(client: Illumination, controller: SimulatedController) -> None:
    """Delay 10 and width 50 ticks of 32 us: light from 320 us to 1920 us after the edge."""
    client.write(Register.STROBE_DELAY, 10)
    client.write(Register.STROBE_WIDTH, 50)
    client.set_level(250)
    controller.run_ms(250)
    assert controller.led_share(5) == 0.0
    edge = controller.cycle
    controller.trigger()
    on, off = controller.led_edges(5)
    assert (on - edge) / CLOCK_HZ * 1e6 == pytest.approx(320, abs=40)
    assert (off - edge) / CLOCK_HZ * 1e6 == pytest.approx(1920, abs=40)
    assert client.read(Register.TRIGGERS) == 1


def test_a_hung_controller_resets_itself_in_the_dark(
    client: Illumination, controller: SimulatedController
) -> None:
    client.set_level(255)
    controller.run_ms(250)
    controller.stop_tick()
    controller.run_ms(400)
    assert controller.led_share(10) == 0.0
    assert Fault.RESET_WATCHDOG in client.state().faults


def test_brown_out_is_told(client: Illumination, controller: SimulatedController) -> None:
    client.set_level(255)
    controller.brown_out()
    controller.run_ms(20)
    assert controller.led_share(5) == 0.0
    assert Fault.RESET_BROWN_OUT in client.state().faults


def test_a_client_of_another_map_is_refused(bus: WireSmBus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate_edge.illumination.MAP_CRC", 0x1234)
    with pytest.raises(IlluminationError, match=r"MAP_CRC is .*not 1234h: flash the firmware"):
        Illumination(bus, "simulated wires")


def test_noise_on_the_wires_leaves_the_controller_alive(client: Illumination, bus: WireSmBus) -> None:
    for message in (
        [I2C_ADDRESS << 1],
        [I2C_ADDRESS << 1, 3],
        [I2C_ADDRESS << 1, 3, 1, 2, 3, 4, 5, 6],
        [0x00],
        [0xFF],
    ):
        try:
            bus.send(message)
        except OSError:
            continue
    assert client.read(Register.IDENTITY) == 0x5041
    assert client.read(Register.LEVEL) == 0
