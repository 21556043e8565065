"""core.c compiled for this machine: properties of level, temperatures, faults and SMBus bytes."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable
from pathlib import Path

import pytest
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

REGISTERS = 0x18
WRITE, READ = I2C_ADDRESS << 1, I2C_ADDRESS << 1 | 1
ROOM, HOT = 512, 128  # ADC readings: 25 and 76 degC by the B equation


class Core(ctypes.Structure):
    """core_t of core.h."""

    _fields_ = [
        ("reg", ctypes.c_uint16 * REGISTERS),
        ("level_now", ctypes.c_uint16),
        ("silent_ms", ctypes.c_uint16),
        ("ms", ctypes.c_uint16),
        ("cool", ctypes.c_bool),
        ("received", ctypes.c_uint8),
        ("sent", ctypes.c_uint8),
        ("crc", ctypes.c_uint8),
        ("command", ctypes.c_uint8),
        ("value", ctypes.c_uint16),
    ]


class Logic:
    """One controller's logic; `ms` lets time pass with both thermistors at a reading."""

    def __init__(self, library: ctypes.CDLL, reset_faults: int = 0) -> None:
        self.c = library
        self.core = Core()
        self._p = ctypes.byref(self.core)
        self.c.core_init(self._p, reset_faults)

    def ms(self, count: int, led: int = ROOM, silicone: int = ROOM) -> None:
        for _ in range(count):
            self.c.core_temperatures(self._p, led, silicone)
            self.c.core_tick_ms(self._p)

    def bytes_in(self, data: bytes) -> list[bool]:
        """A write with these bytes after the address, and a stop; the acknowledge asked after each."""
        self.c.smbus_start(self._p, WRITE)
        asked = [bool(self.c.smbus_write(self._p, byte)) for byte in data]
        self.c.smbus_stop(self._p)
        return asked

    def write(self, register: int, value: int) -> None:
        data = bytes([register, value & 0xFF, value >> 8])
        self.bytes_in(data + bytes([crc8(bytes([WRITE]) + data)]))

    def read(self, register: int) -> tuple[int, bool]:
        """Value, and whether its PEC is right."""
        self.c.smbus_start(self._p, WRITE)
        self.c.smbus_write(self._p, register)
        self.c.smbus_stop(self._p)
        self.c.smbus_start(self._p, READ)
        low, high, pec = (self.c.smbus_read(self._p) for _ in range(3))
        self.c.smbus_stop(self._p)
        return low | high << 8, pec == crc8(bytes([WRITE, register, READ, low, high]))

    def bare_read(self) -> bytes:
        """Three bytes asked for without a command first."""
        self.c.smbus_start(self._p, READ)
        return bytes(self.c.smbus_read(self._p) for _ in range(3))

    def tick(self) -> None:
        """One ms without a reading of the thermistors."""
        self.c.core_tick_ms(self._p)

    def stop(self) -> None:
        self.c.smbus_stop(self._p)

    def triggers(self, count: int) -> None:
        self.c.core_triggers(self._p, count)

    def duty(self) -> int:
        return int(self.core.reg[LightRegister.DUTY])

    def faults(self) -> Fault:
        return Fault(self.core.reg[LightRegister.FAULTS])


@pytest.fixture(scope="module")
def new(logic: Path) -> Callable[[int], Logic]:
    library = ctypes.CDLL(str(logic))
    library.core_duty.restype = ctypes.c_uint16
    library.smbus_write.restype = ctypes.c_bool
    library.smbus_read.restype = ctypes.c_uint8
    library.thermistor_dC.restype = ctypes.c_int16
    return lambda reset_faults=0: Logic(library, reset_faults)


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
        assert new().c.thermistor_dC(adc) / 10 == pytest.approx(kelvin - 273.15, abs=within_degC)


@given(st.integers(0, 255))
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
@settings(deadline=None)
def test_heat_never_brightens_and_the_cut_off_is_dark(new: Callable[[], Logic], led: int, level: int) -> None:
    core, cooler = new(), new()
    for each, adc in ((core, led), (cooler, min(led + 5, 1010))):
        each.write(LightRegister.LEVEL, level)
        each.ms(300, led=adc)
    assert core.duty() <= cooler.duty()
    degC = core.c.thermistor_dC(led) / 10
    assert (Fault.OVER_TEMPERATURE in core.faults()) == (degC >= 75.0)
    if degC >= 75.0:
        assert core.duty() == 0


def test_half_way_between_start_and_cut_off_half_the_level_is_left(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.LEVEL, 255)
    adc = next(a for a in range(1, 1024) if core.c.thermistor_dC(a) <= 675)
    core.ms(300, led=adc)
    assert core.core.level_now / (255 << 8) == pytest.approx(0.5, abs=0.05)


def test_over_temperature_stays_until_it_is_cool_and_cleared(new: Callable[[], Logic]) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, 10_000)
    core.write(LightRegister.LEVEL, 255)
    core.ms(10, led=HOT)
    core.write(LightRegister.FAULT_CLEAR, 0xFF)
    assert Fault.OVER_TEMPERATURE in core.faults()
    core.ms(500)
    assert core.duty() == 0
    core.write(LightRegister.FAULT_CLEAR, 0xFF)
    core.ms(500)
    assert core.faults() == Fault(0)
    assert core.duty() == 1023


@pytest.mark.parametrize("adc", [12, 1011])
def test_the_last_readings_of_a_whole_thermistor(new: Callable[[], Logic], adc: int) -> None:
    core = new()
    core.ms(1, led=adc)
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
@settings(max_examples=20, deadline=None)
def test_silence_darkens_after_the_watchdogs_time(new: Callable[[], Logic], watchdog_ms: int) -> None:
    core = new()
    core.write(LightRegister.WATCHDOG, watchdog_ms)
    core.write(LightRegister.SOFT_START, 0)
    core.write(LightRegister.LEVEL, 200)
    core.ms(watchdog_ms)
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
    core.write(LightRegister.CUT_OFF, core.c.thermistor_dC(HOT))
    core.ms(1, led=HOT)
    assert Fault.OVER_TEMPERATURE in core.faults()
    adc = next(a for a in range(HOT, ROOM) if 300 <= core.c.thermistor_dC(a) <= 600)
    core.write(LightRegister.DERATE_START, core.c.thermistor_dC(adc))
    core.ms(1, led=adc)
    core.write(LightRegister.FAULT_CLEAR, 0xFF)
    assert Fault.OVER_TEMPERATURE in core.faults()


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
