"""The illumination controller over I2C (firmware/illumination): LED level, strobe, temperatures, faults.

Every register is an SMBus word with PEC. Writing a register twice does no harm, so a failed transaction is
repeated; every write is read back.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol, TypeVar

import msgspec
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
NO_FAULT = Fault(0)

T = TypeVar("T")


class SmBus(Protocol):
    """The methods of smbus2.SMBus that are used; OSError for a failed transaction."""

    pec: int

    def read_word_data(self, i2c_addr: int, register: int) -> int: ...
    def write_word_data(self, i2c_addr: int, register: int, value: int) -> None: ...
    def close(self) -> None: ...


class IlluminationState(msgspec.Struct, frozen=True):
    """Measurements and counters of the controller. duty: 0 to 1.

    faults: since the reset or since they were cleared; present: those whose cause persists.
    triggers: edges of the camera's trigger; pec_errors: writes refused for a wrong PEC; both modulo 2^16,
    since the controller's reset.
    """

    led_degC: float
    silicone_degC: float
    duty: float
    faults: Fault
    triggers: int = 0
    pec_errors: int = 0
    present: Fault = NO_FAULT


class IlluminationClient:
    """One controller; its watchdog turns the LEDs off after a time without a transaction (WATCHDOG)."""

    def __init__(self, bus: SmBus, name: str, address: int = I2C_ADDRESS) -> None:
        """Raises IlluminationError when no controller answers, or a device of another kind or version."""
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
                    f"{self._name}: {register.name} is {found:04X}h, not {value:04X}h: flash the "
                    "firmware that belongs to this version"
                )

    @classmethod
    def open(cls, bus_number: int, address: int = I2C_ADDRESS) -> IlluminationClient:
        """Open the controller on /dev/i2c-N. Raises IlluminationError as the constructor does, or without
        that bus."""
        try:
            bus = SMBus(bus_number)
        except OSError as exc:
            raise IlluminationError(
                f"/dev/i2c-{bus_number}: {exc.strerror}: enable I2C and add the user to group i2c"
            ) from exc
        try:
            return cls(bus, f"/dev/i2c-{bus_number}", address)
        except IlluminationError:  # retried four times a second: the descriptor must not stay open
            bus.close()
            raise

    def close(self) -> None:
        """Close the I2C bus."""
        self._bus.close()

    def read(self, register: LightRegister) -> int:
        """Read a register; the value is signed for registers in SIGNED."""
        value = self._repeat(register, lambda: self._bus.read_word_data(self._address, register))
        return value - 0x10000 if register in SIGNED and value & 0x8000 else value

    def write(self, register: LightRegister, value: int) -> None:
        """Write a register and read it back. Raises IlluminationError out of range or when it reads back
        differently."""
        least, greatest = RANGES[register]
        if not least <= value <= greatest:
            raise IlluminationError(f"{register.name} = {value} is out of range: {least} to {greatest}")

        def write_and_verify() -> None:
            self._bus.write_word_data(self._address, register, value)
            if register is not LightRegister.FAULT_CLEAR and self.read(register) != value:
                raise OSError(0, "another value was read back")

        self._repeat(register, write_and_verify)

    def set_level(self, level: int) -> None:
        """Set the brightness, 0 to 255."""
        self.write(LightRegister.LEVEL, level)

    def clear(self, faults: Fault) -> None:
        """Clear latched faults; the controller sets a fault again while its cause persists."""
        self.write(LightRegister.FAULT_CLEAR, int(faults))

    def state(self) -> IlluminationState:
        """Read measurements, faults and counters."""
        return IlluminationState(
            led_degC=self.read(LightRegister.LED_TEMPERATURE) * SCALE_degC,
            silicone_degC=self.read(LightRegister.SILICONE_TEMPERATURE) * SCALE_degC,
            duty=self.read(LightRegister.DUTY) / 1023,
            faults=Fault(self.read(LightRegister.FAULTS)),
            triggers=self.read(LightRegister.TRIGGERS),
            pec_errors=self.read(LightRegister.PEC_ERRORS),
            present=Fault(self.read(LightRegister.PRESENT)),
        )

    def _repeat(self, register: LightRegister, transaction: Callable[[], T]) -> T:
        """Return the result of the transaction. Raises IlluminationError when it fails ATTEMPTS times."""
        for _ in range(ATTEMPTS - 1):
            try:
                return transaction()
            except OSError:
                time.sleep(PAUSE_S)
        try:
            return transaction()
        except OSError as exc:
            raise IlluminationError(
                f"{self._name}: {register.name} failed {ATTEMPTS} times ({exc.strerror}): "
                "check power and wiring"
            ) from exc
