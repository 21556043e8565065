"""core.c on this machine and on the simulated chip: level, temperatures, faults and SMBus bytes."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import Any

import pytest
from firmware_rig.firmware_calls import ChipCalls, FirmwareCalls, HostCalls
from firmware_rig.need import need_simulator
from firmware_rig.smbus_adapter import crc8
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.illumination.registers import (
    I2C_ADDRESS,
    IDENTITY,
    MAP_CRC,
    RANGES,
    VERSION,
    Fault,
    LightRegister,
)

WRITE, READ = I2C_ADDRESS << 1, I2C_ADDRESS << 1 | 1
ROOM, HOT = 512, 128  # ADC readings: 25 and 76 degC by the B equation
STEP = 4  # ADC steps that a temperature follows in one reading
BROKEN = 32  # readings


class Logic:
    """One controller's logic; `ms` lets time pass with both thermistors at a reading."""

    def __init__(self, firmware: FirmwareCalls, reset_faults: int = 0) -> None:
        self.firmware = firmware
        self._p = firmware.new()
        self._call("core_init", reset_faults)

    def _call(self, name: str, *arguments: int) -> int:
        return self.firmware.call(name, self._p, *arguments)

    @property
    def core(self) -> Any:
        """The present content of core_t."""
        return self.firmware.core(self._p)

    def dC(self, adc: int) -> int:
        """The firmware's temperature at a reading, in 0.1 degC."""
        value = self.firmware.call("thermistor_dC", adc)
        return value - 0x10000 if value & 0x8000 else value

    def ms(self, count: int, led: int = ROOM, silicone: int = ROOM) -> None:
        for _ in range(count):
            self.reading(led, silicone)
            self.tick()

    def reading(self, led: int = ROOM, silicone: int = ROOM) -> None:
        """One reading of each thermistor; no time passes."""
        self._call("core_temperatures", led, silicone)

    def settle(self, led: int = ROOM, silicone: int = ROOM) -> None:
        """Readings until the temperatures have followed."""
        for _ in range(1024 // STEP):
            self.reading(led, silicone)

    def bytes_in(self, data: bytes) -> list[bool]:
        """A write with these bytes after the address, and a stop; the acknowledge asked after each."""
        self._call("smbus_start", WRITE)
        asked = [bool(self._call("smbus_write", byte) & 0xFF) for byte in data]
        self._call("smbus_stop")
        return asked

    def write(self, register: int, value: int) -> None:
        data = bytes([register, value & 0xFF, value >> 8])
        self.bytes_in(data + bytes([crc8(bytes([WRITE]) + data)]))

    def read(self, register: int) -> tuple[int, bool]:
        """Value, and whether its PEC is right."""
        self._call("smbus_start", WRITE)
        self._call("smbus_write", register)
        self._call("smbus_stop")
        self._call("smbus_start", READ)
        low, high, pec = (self._call("smbus_read") & 0xFF for _ in range(3))
        self._call("smbus_stop")
        return low | high << 8, pec == crc8(bytes([WRITE, register, READ, low, high]))

    def bare_read(self) -> bytes:
        """Three bytes asked for without a command first."""
        self._call("smbus_start", READ)
        return bytes(self._call("smbus_read") & 0xFF for _ in range(3))

    def tick(self) -> None:
        """One ms without a reading of the thermistors."""
        self._call("core_tick_ms")

    def stop(self) -> None:
        self._call("smbus_stop")

    def triggers(self, count: int) -> None:
        self._call("core_triggers", count)

    def duty(self) -> int:
        return int(self.core.reg[LightRegister.DUTY])

    def present(self) -> Fault:
        return Fault(self.core.reg[LightRegister.PRESENT])

    def faults(self) -> Fault:
        return Fault(self.core.reg[LightRegister.FAULTS])


@pytest.fixture(scope="module", params=["PC", "AVR"])
def new(request: pytest.FixtureRequest) -> Callable[..., Logic]:
    """Controllers' logic, in a library for this machine and in the binary on the simulated chip."""
    firmware: FirmwareCalls
    if request.param == "PC":
        firmware = HostCalls(request.getfixturevalue("logic"))
    else:
        need_simulator()
        firmware = ChipCalls(request.getfixturevalue("build") / "illumination.elf")
    return lambda reset_faults=0: Logic(firmware, reset_faults)


def test_check_value_of_the_crc() -> None:
    """CRC-8/SMBUS of the nine digits is F4h in the catalogue of CRCs."""
    assert crc8(b"123456789") == 0xF4


@pytest.mark.parametrize(("first", "last", "within_degC"), [(102, 860, 0.6), (64, 101, 2.0)])
def test_temperature_is_the_b_equation(
    new: Callable[[], Logic], first: int, last: int, within_degC: float
) -> None:
    """-11 to 89 degC, and up to 103 degC."""
    for adc in range(first, last + 1):
        kelvin = 1 / (1 / 298.15 + math.log(adc / (1024 - adc)) / 3950)
        assert new().dC(adc) / 10 == pytest.approx(kelvin - 273.15, abs=within_degC)


@given(st.integers(0, 255))
@settings(max_examples=40, deadline=None)
def test_duty_is_the_square_of_the_level(new: Callable[[], Logic], level: int) -> None:
    core = new()
    core.write(LightRegister.LEVEL, level)
    core.ms(300)
    assert core.duty() == pytest.approx(1023 * (level / 255) ** 2, abs=1)


@given(st.integers(1, 5000))
@settings(max_examples=20, deadline=None)
def test_soft_start_takes_its_time(new: Callable[[], Logic], soft_start_ms: int) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, 10_000)
    core.write(LightRegister.SOFT_START, soft_start_ms)
    core.write(LightRegister.LEVEL, 255)
    core.ms(1)
    first = core.core.level_now
    core.ms(soft_start_ms - 1)
    assert core.core.level_now == 255 << 8
    assert first <= (255 << 8) / soft_start_ms + 1


def test_dark_comes_at_once(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    core.ms(300)
    core.write(LightRegister.LEVEL, 0)
    core.ms(1)
    assert core.duty() == 0


@given(st.integers(13, 1010), st.integers(0, 255))
@settings(max_examples=30, deadline=None)
def test_heat_never_brightens_and_the_cut_off_is_dark(new: Callable[[], Logic], led: int, level: int) -> None:
    core, cooler = new(), new()
    for each, adc in ((core, led), (cooler, min(led + 5, 1010))):
        each.write(LightRegister.LEVEL, level)
        each.ms(300, led=adc)
    assert core.duty() <= cooler.duty()
    degC = core.dC(led) / 10
    assert (Fault.OVER_TEMPERATURE in core.faults()) == (degC >= 75.0)
    if degC >= 75.0:
        assert core.duty() == 0


def test_half_way_between_start_and_cut_off_half_the_level_is_left(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    adc = next(a for a in range(1, 1024) if core.dC(a) <= 675)
    core.ms(300, led=adc)
    assert core.core.level_now / (255 << 8) == pytest.approx(0.5, abs=0.05)


def test_over_temperature_ends_below_the_start_of_derating_and_stays_recorded(
    new: Callable[[], Logic],
) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, 10_000)
    core.write(LightRegister.LEVEL, 255)
    core.ms(10, led=HOT)
    core.write(LightRegister.FAULT_CLEAR, 0xFF)
    assert core.faults() == core.present() == Fault.OVER_TEMPERATURE
    between = next(a for a in range(HOT, ROOM) if core.dC(a) <= 675)
    core.settle(led=between)
    core.ms(500, led=between)
    assert core.present() == Fault.OVER_TEMPERATURE
    assert core.duty() == 0
    core.settle()
    core.ms(500)
    assert core.present() == Fault(0)
    assert core.faults() == Fault.OVER_TEMPERATURE
    assert core.duty() == 1023
    core.write(LightRegister.FAULT_CLEAR, int(Fault.LED_SENSOR))
    assert core.faults() == Fault.OVER_TEMPERATURE
    core.write(LightRegister.FAULT_CLEAR, 0xFF)
    assert core.faults() == Fault(0)


@pytest.mark.parametrize("wild", [0, 13, HOT, 1010, 1023])
def test_one_wild_reading_neither_dims_nor_is_a_fault(new: Callable[[], Logic], wild: int) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    core.ms(300)
    core.ms(1, led=wild, silicone=wild)
    assert (core.duty(), core.faults()) == (1023, Fault(0))
    core.ms(1)
    assert (core.duty(), core.faults()) == (1023, Fault(0))


@given(
    st.integers(0, 2**32), st.integers(1, 2000), st.sampled_from(["random", "hot", "short", "open", "mixed"])
)
@settings(max_examples=15, deadline=None)
def test_light_is_back_within_a_second_after_wild_readings(
    new: Callable[[], Logic], seed: int, wild_readings: int, kind: str
) -> None:
    """A reading takes 2 ms on the chip."""
    core, rng = new(), random.Random(seed)
    values = {"random": range(1024), "hot": range(13, 129), "short": range(12), "open": range(1012, 1024)}
    values["mixed"] = [0, 1, 13, HOT, ROOM, 1010, 1023]
    core.write(LightRegister.WATCHDOG, 10_000)
    for _ in range(wild_readings):
        core.reading(led=rng.choice(values[kind]), silicone=rng.choice(values[kind]))
    core.write(LightRegister.LEVEL, 255)
    for _ in range(500):
        core.tick()
        core.tick()
        core.reading()
    assert core.present() == Fault(0)
    assert core.duty() == 1023
    assert core.core.reg[LightRegister.LED_TEMPERATURE] == core.core.reg[LightRegister.SILICONE_TEMPERATURE]


@pytest.mark.parametrize("sensor", ["led", "silicone"])
def test_a_temperature_follows_its_readings_in_steps(new: Callable[[], Logic], sensor: str) -> None:
    register = LightRegister[f"{sensor.upper()}_TEMPERATURE"]
    for target in (ROOM - 100, ROOM + 100):
        core = new()
        core.reading()
        sign = 1 if target > ROOM else -1
        for count in range(1, 100 // STEP + 1):
            core.reading(**{sensor: target})
            assert core.core.reg[register] == core.dC(ROOM + sign * STEP * count)
        core.reading(**{sensor: target + 1})  # less than a step
        assert core.core.reg[register] == core.dC(target + 1)


@pytest.mark.parametrize("sensor", ["led", "silicone"])
@pytest.mark.parametrize("broken", [0, 1023])
def test_a_sensor_fault_begins_and_ends_with_32_readings(
    new: Callable[[], Logic], sensor: str, broken: int
) -> None:
    fault = Fault[f"{sensor.upper()}_SENSOR"]
    core = new()
    core.reading()
    for _ in range(BROKEN - 1):
        core.reading(**{sensor: broken})
    assert core.present() == Fault(0)
    for _ in range(10):
        core.reading(**{sensor: broken})
    assert core.present() == fault
    for _ in range(BROKEN - 1):
        core.reading()
    assert core.present() == fault
    core.reading()
    assert core.present() == Fault(0)
    assert core.faults() == fault


def test_a_broken_sensor_keeps_its_last_temperature(new: Callable[[], Logic]) -> None:
    core = new()
    core.reading(led=0, silicone=1023)
    assert core.core.reg[LightRegister.LED_TEMPERATURE] == 0
    assert core.core.reg[LightRegister.SILICONE_TEMPERATURE] == 0
    assert core.present() == Fault(0)
    core.reading(led=256, silicone=300)
    for _ in range(100):
        core.reading(led=0, silicone=1023)
    assert core.core.reg[LightRegister.LED_TEMPERATURE] == core.dC(256)
    assert core.core.reg[LightRegister.SILICONE_TEMPERATURE] == core.dC(300)


@pytest.mark.parametrize("adc", [12, 1011])
def test_the_last_readings_of_a_whole_thermistor(new: Callable[[], Logic], adc: int) -> None:
    core = new()
    core.ms(100, led=adc)
    assert Fault.LED_SENSOR not in core.faults()


@pytest.mark.parametrize("adc", [0, 11, 1012, 1023])
def test_a_broken_led_thermistor_darkens(new: Callable[[], Logic], adc: int) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    core.ms(300, led=adc)
    assert Fault.LED_SENSOR in core.faults()
    assert core.core.level_now == 0


def test_a_broken_silicone_thermistor_is_told_and_the_light_stays(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    core.ms(300, silicone=1023)
    assert core.faults() == Fault.SILICONE_SENSOR
    assert core.duty() == 1023


@given(st.integers(100, 10_000))
@settings(max_examples=8, deadline=None)
def test_silence_darkens_after_the_watchdogs_time(new: Callable[[], Logic], watchdog_ms: int) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, watchdog_ms)
    core.write(LightRegister.SOFT_START, 0)
    core.write(LightRegister.LEVEL, 200)
    core.reading()
    for _ in range(watchdog_ms):
        core.tick()
    assert core.duty() > 0
    core.ms(1)
    assert core.duty() == 0
    assert core.faults() == Fault.BOARD_SILENT
    assert core.core.reg[LightRegister.LEVEL] == 0


def test_reading_keeps_the_light(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 200)
    for _ in range(5):
        core.ms(900)
        assert core.read(LightRegister.FAULTS) == (0, True)
    assert core.duty() > 0


@given(st.integers(0, 0xFF), st.integers(0, 0xFFFF))
@settings(deadline=None)
def test_only_what_the_table_allows_is_written(new: Callable[[], Logic], register: int, value: int) -> None:
    core = new()
    before = list(core.core.reg)
    core.write(register, value)
    after = list(core.core.reg)
    allowed = (
        register in {int(r) for r in RANGES}
        and RANGES[LightRegister(register)][0] <= value <= RANGES[LightRegister(register)][1]
    )
    if register == LightRegister.DERATE_START:
        allowed = allowed and value < before[LightRegister.CUT_OFF]
    if register == LightRegister.CUT_OFF:
        allowed = allowed and value > before[LightRegister.DERATE_START]
    if allowed and register != LightRegister.FAULT_CLEAR:
        before[register] = value
    assert after == before


@given(st.binary(max_size=8))
@settings(deadline=None)
def test_any_bytes_leave_a_sane_controller(new: Callable[[], Logic], data: bytes) -> None:
    core = new()
    before = list(core.core.reg)
    core.bytes_in(data)
    whole = len(data) == 4 and crc8(bytes([WRITE]) + data[:3]) == data[3]
    if not whole:
        before[LightRegister.PEC_ERRORS] = core.core.reg[LightRegister.PEC_ERRORS]
        assert list(core.core.reg) == before
    assert core.read(LightRegister.IDENTITY) == (0x5041, True)


@given(st.integers(0, 255))
@settings(deadline=None)
def test_what_does_not_exist_reads_with_a_wrong_pec(new: Callable[[], Logic], register: int) -> None:
    readable = {int(r) for r in LightRegister} - {LightRegister.FAULT_CLEAR}
    assert new().read(register)[1] == (register in readable)


def test_a_wrong_pec_is_counted_and_the_write_forgotten(new: Callable[[], Logic]) -> None:
    core = new()
    data = bytes([LightRegister.LEVEL, 100, 0])
    core.bytes_in(data + bytes([crc8(bytes([WRITE]) + data) ^ 1]))
    assert core.core.reg[LightRegister.LEVEL] == 0
    assert core.core.reg[LightRegister.PEC_ERRORS] == 1


def test_reset_causes_are_faults(new: Callable[[int], Logic]) -> None:
    assert new(int(Fault.RESET_WATCHDOG)).faults() == Fault.RESET_WATCHDOG


def test_uptime_counts_seconds(new: Callable[[], Logic]) -> None:
    core = new()
    core.ms(999)
    assert core.read(LightRegister.UPTIME) == (0, True)
    core.ms(1)
    assert core.read(LightRegister.UPTIME) == (1, True)
    core.ms(2000)
    assert core.read(LightRegister.UPTIME) == (3, True)
    core.ms(999)
    assert core.read(LightRegister.UPTIME) == (3, True)


def test_cut_off_stays_above_the_start_of_derating(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.DERATE_START, 750)
    assert core.core.reg[LightRegister.DERATE_START] == 600
    core.write(LightRegister.DERATE_START, 749)
    assert core.core.reg[LightRegister.DERATE_START] == 749
    core.write(LightRegister.CUT_OFF, 749)
    assert core.core.reg[LightRegister.CUT_OFF] == 750
    core.write(LightRegister.DERATE_START, 500)
    core.write(LightRegister.CUT_OFF, 501)
    assert core.core.reg[LightRegister.CUT_OFF] == 501


def test_the_limits_belong_to_the_hot_side(new: Callable[[], Logic]) -> None:
    """At CUT_OFF itself it is too hot, at DERATE_START itself not yet cool."""
    core = new()
    core.write(LightRegister.CUT_OFF, core.dC(HOT))
    core.ms(1, led=HOT)
    assert Fault.OVER_TEMPERATURE in core.faults()
    adc = next(a for a in range(HOT, ROOM) if 300 <= core.dC(a) <= 600)
    core.write(LightRegister.DERATE_START, core.dC(adc))
    core.settle(led=adc)
    assert core.present() == Fault.OVER_TEMPERATURE
    core.settle(led=adc + 1)
    assert core.present() == Fault(0)


def test_a_step_of_the_soft_start_is_no_larger_than_needed(new: Callable[[], Logic]) -> None:
    """255 levels in 255 ms: one level a millisecond."""
    core = new()
    core.write(LightRegister.SOFT_START, 255)
    core.write(LightRegister.LEVEL, 255)
    for ms in range(1, 256):
        core.ms(1)
        assert core.core.level_now == ms << 8


def test_it_tells_what_it_is(new: Callable[[], Logic]) -> None:
    core = new()
    assert core.read(LightRegister.IDENTITY) == (IDENTITY, True)
    assert core.read(LightRegister.VERSION) == (VERSION, True)
    assert core.read(LightRegister.MAP_CRC) == (MAP_CRC, True)


def test_both_temperatures_are_told(new: Callable[[], Logic]) -> None:
    """10 kOhm at 25 degC; a third of it at 52.0 degC by the B equation."""
    core = new()
    core.ms(1, led=ROOM, silicone=256)
    assert core.core.reg[LightRegister.LED_TEMPERATURE] == pytest.approx(250, abs=3)
    assert core.core.reg[LightRegister.SILICONE_TEMPERATURE] == pytest.approx(520, abs=5)


def test_a_cut_off_lowered_below_the_temperature_darkens_before_the_next_reading(
    new: Callable[[], Logic],
) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    core.ms(300, led=256)  # 52 degC
    assert core.duty() == 1023
    core.write(LightRegister.DERATE_START, 300)
    core.write(LightRegister.CUT_OFF, 400)
    core.tick()
    assert core.core.level_now == 0


def test_triggers_are_counted_from_a_counter_of_one_byte(new: Callable[[], Logic]) -> None:
    core = new()
    for count in (1, 1, 3, 250, 4):  # 3, 247 and 10 more, once past 255
        core.triggers(count)
    assert core.core.reg[LightRegister.TRIGGERS] == 260


@pytest.mark.parametrize("way", ["read", "write"])
def test_each_transaction_starts_the_watchdogs_time_anew(new: Callable[[], Logic], way: str) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, 100)
    core.write(LightRegister.SOFT_START, 0)
    core.write(LightRegister.LEVEL, 200)
    core.ms(60)
    if way == "read":
        core.read(LightRegister.FAULTS)
    else:
        core.write(LightRegister.SOFT_START, 0)
    core.ms(100)
    assert core.duty() > 0
    core.ms(1)
    assert core.duty() == 0


@pytest.mark.parametrize(("level", "acknowledged"), [(255, True), (256, False)])
def test_the_pec_is_acknowledged_when_the_write_is_allowed_and_no_byte_after_it(
    new: Callable[[], Logic], level: int, acknowledged: bool
) -> None:
    data = bytes([LightRegister.LEVEL, level & 0xFF, level >> 8])
    asked = new().bytes_in(data + bytes([crc8(bytes([WRITE]) + data)]))
    assert asked == [True, True, acknowledged, False]


def test_a_read_without_a_command_never_looks_right(new: Callable[[], Logic]) -> None:
    core = new()
    core.read(LightRegister.IDENTITY)
    low, high, pec = core.bare_read()
    assert pec != crc8(bytes([READ, low, high]))
    data = bytes([WRITE, LightRegister.LEVEL, 100, 0])
    data += bytes([crc8(data)])
    core.bytes_in(data[1:])
    low, high, pec = core.bare_read()
    assert pec != crc8(data + bytes([READ, low, high]))


def test_a_second_stop_does_not_write_again(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, 100)
    core.write(LightRegister.LEVEL, 100)
    core.ms(101)
    assert core.core.reg[LightRegister.LEVEL] == 0
    core.stop()
    assert core.core.reg[LightRegister.LEVEL] == 0
