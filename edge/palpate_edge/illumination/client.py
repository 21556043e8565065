"""The illumination controller over I2C (firmware/illumination): LED level, strobe, temperatures, faults.

Every register is an SMBus word with PEC. All of them may be written twice, so a transaction that the bus lost
is repeated; what is written is read back.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from smbus2 import SMBus

from palpate_edge.common.errors import IlluminationError
from palpate_edge.illumination.registers import (
    I2C_ADDRESS,
    IDENTITY,
    MAP_CRC,
    RANGES,
    SIGNED,
    VERSION,
    Fault,
    LightRegister,
)

ATTEMPTS = 3
PAUSE_S = 0.001
SCALE_degC = 0.1

T = TypeVar("T")


class SmBus(Protocol):
    """What is used of smbus2.SMBus; OSError for a transaction that failed."""

    pec: int

    def read_word_data(self, i2c_addr: int, register: int) -> int: ...
    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None: ...
    def close(self) -> None: ...


@dataclass(frozen=True, slots=True)
class IlluminationState:
    """What the controller measures. duty: 0 to 1."""

    led_degC: float
    silicone_degC: float
    duty: float
    faults: Fault


class IlluminationClient:
    """One controller; its watchdog darkens the LEDs when nobody asks for its (WATCHDOG) time."""

    def __init__(self, bus: SmBus, name: str, address: int = I2C_ADDRESS) -> None:
        """IlluminationError when nobody answers, or something else or another version does."""
        self._bus = bus
        self._name = f"illumination controller {address:02X}h on {name}"
        self._address = address
        bus.pec = 1
        expected = {
            LightRegister.IDENTITY: IDENTITY,
            LightRegister.VERSION: VERSION,
            LightRegister.MAP_CRC: MAP_CRC,
        }
        for register, value in expected.items():
            found = self.read(register)
            if found != value:
                raise IlluminationError(
                    f"{self._name}: {register.name} is {found:04X}h, not {value:04X}h: flash the"
                    " firmware that belongs to this version"
                )

    @classmethod
    def open(cls, bus_number: int, address: int = I2C_ADDRESS) -> IlluminationClient:
        """The controller on /dev/i2c-N; IlluminationError as the constructor, or without that bus."""
        try:
            bus = SMBus(bus_number)
        except OSError as exc:
            raise IlluminationError(
                f"/dev/i2c-{bus_number}: {exc.strerror}: enable I2C and add the user to group i2c"
            ) from exc
        try:
            return cls(bus, f"/dev/i2c-{bus_number}", address)
        except IlluminationError:  # tried again four times a second: its descriptor must not stay
            bus.close()
            raise

    def close(self) -> None:
        self._bus.close()

    def read(self, register: LightRegister) -> int:
        """One register; signed where it says so."""
        value = self._repeated(register, lambda: self._bus.read_word_data(self._address, register))
        return value - 0x10000 if register in SIGNED and value & 0x8000 else value

    def write(self, register: LightRegister, value: int) -> None:
        """One register, read back; IlluminationError when out of range or not taken."""
        least, greatest = RANGES[register]
        if not least <= value <= greatest:
            raise IlluminationError(f"{register.name} {value} is not {least} to {greatest}")

        def write_and_look() -> None:
            self._bus.write_word_data(self._address, register, value)
            if register is not LightRegister.FAULT_CLEAR and self.read(register) != value:
                raise OSError(0, "another value was read back")

        self._repeated(register, write_and_look)

    def set_level(self, level: int) -> None:
        """Brightness 0 to 255."""
        self.write(LightRegister.LEVEL, level)

    def clear(self, faults: Fault) -> None:
        """Clear latched faults; one whose cause stays comes back."""
        self.write(LightRegister.FAULT_CLEAR, int(faults))

    def state(self) -> IlluminationState:
        return IlluminationState(
            led_degC=self.read(LightRegister.LED_TEMPERATURE) * SCALE_degC,
            silicone_degC=self.read(LightRegister.SILICONE_TEMPERATURE) * SCALE_degC,
            duty=self.read(LightRegister.DUTY) / 1023,
            faults=Fault(self.read(LightRegister.FAULTS)),
        )

    def _repeated(self, register: LightRegister, transaction: Callable[[], T]) -> T:
        """What the transaction gives; IlluminationError when it fails as often as it may."""
        for _ in range(ATTEMPTS - 1):
            try:
                return transaction()
            except OSError:
                time.sleep(PAUSE_S)
        try:
            return transaction()
        except OSError as exc:
            raise IlluminationError(
                f"{self._name}: {register.name} failed {ATTEMPTS} times ({exc.strerror}):"
                " check power and wiring"
            ) from exc
