"""The real binary on a simulated ATmega328P, by its pins alone; the client of the board on top of them."""

from __future__ import annotations

from pathlib import Path

import pytest
from firmware_rig.need import need_simulator
from firmware_rig.simulated_controller import CLOCK_HZ, SimulatedController
from firmware_rig.smbus_adapter import WireSmBus, crc8

from palpate_edge.common.errors import IlluminationError
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.registers import I2C_ADDRESS, Fault, LightRegister

TICK = CLOCK_HZ // 1000  # cycles
PHASES = 30
PWM_PERIOD = 1024  # cycles
ROOM_ADC, HOT_ADC = 512, 128  # 25 and 76 degC by the B equation


@pytest.fixture
def bus(controller: SimulatedController) -> WireSmBus:
    return WireSmBus(controller)


@pytest.fixture
def client(bus: WireSmBus) -> IlluminationClient:
    return IlluminationClient(bus, "simulated wires")


def test_nobody_at_another_address(bus: WireSmBus) -> None:
    with pytest.raises(OSError, match="Remote I/O"):
        bus.read_word_data(I2C_ADDRESS + 1, LightRegister.IDENTITY)


def test_client_sets_the_level_and_the_pwm_follows(
    client: IlluminationClient, controller: SimulatedController
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


def test_client_reads_temperatures(client: IlluminationClient, controller: SimulatedController) -> None:
    controller.set_adc(0, 256)  # 10 kOhm to a third of it: 52.0 degC by the B equation
    controller.set_adc(1, ROOM_ADC)
    controller.run_ms(200)
    state = client.state()
    assert state.led_degC == pytest.approx(52.0, abs=0.5)
    assert state.silicone_degC == pytest.approx(25.0, abs=0.3)
    assert state.faults == Fault(0)


def test_client_refuses_out_of_range_before_the_wire(client: IlluminationClient) -> None:
    with pytest.raises(IlluminationError, match="LEVEL = 256 is out of range: 0 to 255"):
        client.set_level(256)


def test_out_of_range_on_the_wire_is_not_acknowledged(bus: WireSmBus) -> None:
    with pytest.raises(OSError, match="Remote I/O"):
        bus.write_word_data(I2C_ADDRESS, LightRegister.LEVEL, 256)
    assert bus.read_word_data(I2C_ADDRESS, LightRegister.LEVEL) == 0


def test_silence_of_the_board_darkens(client: IlluminationClient, controller: SimulatedController) -> None:
    client.write(LightRegister.WATCHDOG, 100)
    client.set_level(200)
    controller.run_ms(150)
    assert controller.led_share(10) == 0.0
    assert client.state().faults == Fault.BOARD_SILENT
    client.clear(Fault.BOARD_SILENT)
    assert client.state().faults == Fault(0)


def test_heat_darkens_without_the_board(client: IlluminationClient, controller: SimulatedController) -> None:
    client.set_level(255)
    controller.run_ms(250)
    controller.set_adc(0, HOT_ADC)
    controller.run_ms(250)  # the temperature follows by 4 ADC steps in 2 ms
    assert controller.led_share(5) == 0.0
    assert Fault.OVER_TEMPERATURE in client.state().faults


@pytest.mark.parametrize("soft_start_ms", [0, 1, 255, 256, 257, 1000, 5000])
def test_soft_start_of_any_length_ends_in_full_light(
    client: IlluminationClient, controller: SimulatedController, soft_start_ms: int
) -> None:
    """A step is rounded up to 1/65280 of the level: 5000 ms become 4663."""
    client.write(LightRegister.WATCHDOG, 10_000)
    client.write(LightRegister.SOFT_START, soft_start_ms)
    client.set_level(255)
    begin = controller.cycle
    controller.run_ms(2)
    if soft_start_ms >= 255:
        controller.run_ms(0.85 * soft_start_ms)
        assert 0 < client.state().duty < 1
    controller.run_ms(max(0, soft_start_ms - (controller.cycle - begin) / TICK + 2))
    assert client.state().duty == 1
    assert controller.led_share(5) == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize("pause_ms", [0, 0.5, 1, 1.5, 2, 3])
def test_the_first_conversions_after_the_reference_was_chosen_are_discarded(
    build: Path, pause_ms: float
) -> None:
    """76 degC during the first conversion of each input, 25 degC after it."""
    need_simulator()
    controller = SimulatedController(build / "illumination.elf")
    for channel in (0, 1):
        controller.set_adc(channel, HOT_ADC)
    controller.run_ms(1.5)
    controller.set_adc(0, ROOM_ADC)
    controller.set_adc(1, ROOM_ADC)
    controller.run_ms(pause_ms)
    bus = WireSmBus(controller)
    for register in (LightRegister.LED_TEMPERATURE, LightRegister.SILICONE_TEMPERATURE):
        assert bus.read_word_data(I2C_ADDRESS, register) in (0, 250)


def test_a_read_that_was_cut_off_leaves_the_bus_free(
    client: IlluminationClient, controller: SimulatedController
) -> None:
    """The controller holds SDA low for the first bit of IDENTITY's low byte; the board clocks no more."""
    controller.start()
    assert controller.send(I2C_ADDRESS << 1)
    assert controller.send(LightRegister.IDENTITY)
    controller.start()
    assert controller.send(I2C_ADDRESS << 1 | 1)
    controller.release()
    controller.run_ms(5)
    assert not controller.bus_is_free
    controller.run_ms(40)
    assert controller.bus_is_free
    assert client.read(LightRegister.IDENTITY) == 0x5041


def flash_after(
    controller: SimulatedController, client: IlluminationClient, edge: int, traffic: bool = False
) -> tuple[float, float]:
    """When light comes and goes after a trigger at a cycle, in us; `traffic` talks on I2C all the while."""
    controller.trigger_at(edge)
    while controller.cycle < edge + 5 * TICK:
        if traffic:
            client.read(LightRegister.FAULTS)
        else:
            controller.run_ms(0.5)
    on, off = controller.led_edges(edge)
    return (on - edge) / CLOCK_HZ * 1e6, (off - edge) / CLOCK_HZ * 1e6


def strobe(client: IlluminationClient, controller: SimulatedController, delay: int, width: int) -> None:
    client.write(LightRegister.STROBE_DELAY, delay)
    client.write(LightRegister.STROBE_WIDTH, width)
    client.set_level(250)
    controller.run_ms(250)


def test_flash_follows_the_trigger(client: IlluminationClient, controller: SimulatedController) -> None:
    """Delay 10 and width 50 ticks of 32 us: light from 320 us to 1920 us after the edge."""
    strobe(client, controller, 10, 50)
    assert controller.led_share(5) == 0.0
    on, off = flash_after(controller, client, controller.cycle)
    assert on == pytest.approx(320, abs=40)
    assert off == pytest.approx(1920, abs=40)
    assert client.read(LightRegister.TRIGGERS) == 1


@pytest.mark.parametrize("traffic", [False, True], ids=["quiet", "I2C traffic"])
@pytest.mark.parametrize(("delay", "width"), [(10, 50), (1, 1), (0, 1)])
def test_no_phase_of_the_tick_delays_the_flash(
    client: IlluminationClient, controller: SimulatedController, delay: int, width: int, traffic: bool
) -> None:
    """30 triggers, each 1/30 ms later against the tick: docs/illumination.md states the bounds."""
    strobe(client, controller, delay, width)
    late_us, end_us = [], []
    for phase in range(PHASES):
        next_tick = controller.cycle // TICK + 2
        on, off = flash_after(controller, client, next_tick * TICK + phase * TICK // PHASES, traffic)
        late_us.append(on - 32 * delay)
        end_us.append(off - 32 * (delay + width))
    print(
        f"light {min(late_us):.1f} to {max(late_us):.1f} us late, dark {min(end_us):.1f} to {max(end_us):.1f}"
    )
    constant_us = 0 if delay else 7  # there is no time to make up for the way through the interrupt
    assert all(late == pytest.approx(constant_us, abs=4) for late in late_us)
    assert all(end == pytest.approx(constant_us, abs=4) for end in end_us)
    assert client.read(LightRegister.TRIGGERS) == PHASES


def test_one_edge_gives_one_flash(client: IlluminationClient, controller: SimulatedController) -> None:
    strobe(client, controller, 10, 50)
    flash_after(controller, client, controller.cycle)
    assert controller.led_share(50) == 0.0


@pytest.mark.parametrize("delay", [10, 0])
def test_an_edge_during_a_flash_ends_it_and_begins_anew(
    client: IlluminationClient, controller: SimulatedController, delay: int
) -> None:
    """Width 50 ticks of 32 us; the second edge comes 1000 us after the first."""
    strobe(client, controller, delay, 50)
    first = controller.cycle
    second = first + TICK
    controller.trigger_at(first)
    controller.trigger_at(second)
    controller.run_ms(50)

    def share(after_us: float, before_us: float) -> float:
        return controller.led_share_between(second + round(8 * after_us), second + round(8 * before_us))

    if delay:
        assert share(-100, 0) > 0.9
        assert share(15, 315) == 0.0
    assert share(32 * delay + 10, 32 * delay + 1590) > 0.9
    assert share(32 * delay + 1610, 40_000) == 0.0
    assert client.read(LightRegister.TRIGGERS) == 2


@pytest.mark.parametrize("delay", [10, 0])
def test_steady_light_takes_no_notice_of_edges(
    client: IlluminationClient, controller: SimulatedController, delay: int
) -> None:
    client.write(LightRegister.STROBE_DELAY, delay)
    client.set_level(128)
    controller.run_ms(250)
    periods = controller.led_rises(10)
    for i in range(20):
        controller.trigger_at(controller.cycle + i * 7 * PWM_PERIOD // 2)  # half a period off
    assert controller.led_rises(12) == pytest.approx(periods * 1.2, abs=2)
    assert client.read(LightRegister.TRIGGERS) == 20


def test_the_flash_follows_new_settings_and_steady_light_comes_back(
    client: IlluminationClient, controller: SimulatedController
) -> None:
    strobe(client, controller, 10, 50)
    strobe(client, controller, 20, 10)
    on, off = flash_after(controller, client, controller.cycle)
    assert (on, off) == (pytest.approx(640, abs=4), pytest.approx(960, abs=4))
    client.write(LightRegister.STROBE_WIDTH, 0)
    controller.run_ms(2)
    assert controller.led_share(10) == pytest.approx((250 / 255) ** 2, abs=0.005)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 8])
def test_a_flash_of_any_width_has_the_light_of_its_level(
    client: IlluminationClient, controller: SimulatedController, delay: int, width: int
) -> None:
    """The LED is on for width x 32 us x duty, within 10 cycles (1.3 us) and a step of the duty of 1/256."""
    client.write(LightRegister.WATCHDOG, 10_000)
    client.write(LightRegister.SOFT_START, 0)
    strobe(client, controller, delay, width)
    for level in (40, 128, 180, 255):
        client.set_level(level)
        controller.run_ms(5)
        start = controller.cycle
        flash_after(controller, client, start)
        on = controller.led_share_between(start, controller.cycle) * (controller.cycle - start)
        assert on == pytest.approx(256 * width * (level / 255) ** 2, abs=10 + width)


def test_no_flash_while_it_is_too_hot(client: IlluminationClient, controller: SimulatedController) -> None:
    strobe(client, controller, 0, 255)
    controller.set_adc(0, HOT_ADC)
    controller.run_ms(250)
    controller.trigger_at(controller.cycle)
    assert controller.led_share(10) == 0.0


def test_no_phase_of_the_pwm_delays_the_flash(
    client: IlluminationClient, controller: SimulatedController
) -> None:
    """At a quarter of the light: three of four phases of its period are dark."""
    strobe(client, controller, 1, 50)
    client.set_level(128)
    controller.run_ms(10)
    for phase in range(8):
        period = controller.cycle // PWM_PERIOD + 2
        on, _ = flash_after(controller, client, period * PWM_PERIOD + phase * PWM_PERIOD // 8)
        assert on == pytest.approx(32, abs=4)


def test_pins_at_rest(controller: SimulatedController) -> None:
    """The LED driver is held low; unused inputs are pulled up."""
    assert controller.pin_state("PB1") == "Low"
    assert controller.pin_state("PD3") == "Pull up"


def test_a_hung_controller_resets_itself_in_the_dark(
    client: IlluminationClient, controller: SimulatedController
) -> None:
    client.set_level(255)
    controller.run_ms(250)
    controller.stop_tick()
    controller.run_ms(400)
    assert controller.led_share(10) == 0.0
    assert Fault.RESET_WATCHDOG in client.state().faults


def test_brown_out_is_told(client: IlluminationClient, controller: SimulatedController) -> None:
    client.set_level(255)
    controller.brown_out()
    controller.run_ms(20)
    assert controller.led_share(5) == 0.0
    assert Fault.RESET_BROWN_OUT in client.state().faults


def test_a_client_of_another_map_is_refused(bus: WireSmBus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("palpate_edge.illumination.client.MAP_CRC", 0x1234)
    with pytest.raises(IlluminationError, match=r"MAP_CRC is .*not 1234h: flash the firmware"):
        IlluminationClient(bus, "simulated wires")


def test_a_write_that_goes_on_after_its_pec_is_forgotten(bus: WireSmBus) -> None:
    message = [I2C_ADDRESS << 1, LightRegister.LEVEL, 100, 0]
    with pytest.raises(OSError, match="Remote I/O"):
        bus.send([*message, crc8(bytes(message)), 0])
    assert bus.read_word_data(I2C_ADDRESS, LightRegister.LEVEL) == 0


def test_a_stop_within_a_byte_leaves_the_controller_alive(
    client: IlluminationClient, controller: SimulatedController
) -> None:
    controller.start()
    controller.send(I2C_ADDRESS << 1)
    controller.send_bits(LightRegister.LEVEL, 3)
    controller.stop()
    assert client.read(LightRegister.IDENTITY) == 0x5041
    client.set_level(3)


def test_noise_on_the_wires_leaves_the_controller_alive(client: IlluminationClient, bus: WireSmBus) -> None:
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
    assert client.read(LightRegister.IDENTITY) == 0x5041
    assert client.read(LightRegister.LEVEL) == 0
