"""One RS-485 port with the axes on it: Modbus RTU in, joint motion out. The only I/O of the AZ drives.

Each round has one transaction for each axis: function 17h writes its direct data and reads its motion. No
transaction is repeated: the next round's order replaces a lost one, and a trigger carried out twice would
move the joint twice. In addition, status and alarm or the temperatures of one axis are read in each round.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pymodbus.client import ModbusSerialClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType

from palpate_edge.common.errors import BusError
from palpate_host.drives.az import motor as az
from palpate_host.drives.az.registers import (
    COMMUNICATION_TIMEOUT,
    DIRECT_DATA,
    DRIVER_TEMPERATURE,
    INPUT_COMMAND,
    MOTOR_TEMPERATURE,
    OUTPUT_STATUS,
    PRESENT_ALARM,
    AzRegister,
    AzStatus,
    Input,
    from_words,
    to_words,
)
from palpate_host.drives.az.temperature import AzTemperatures

BAUD_RATE = 230_400
REPLY_TIMEOUT_S = 0.05


class Parity(enum.Enum):
    """The drives' parity setting; even by default, none on a pseudo terminal."""

    EVEN = "E"
    NONE = "N"
    ODD = "O"


@dataclass(frozen=True, slots=True)
class AzHealth:
    """The output status bits of an axis and the code of its present alarm, 0 for none."""

    status: AzStatus
    alarm: int


class AzPort:
    """The axes of one port; every call is one transaction and raises BusError when it fails.

    responses: number received since the port was opened, exception responses included.
    """

    def __init__(
        self,
        path: str,
        baud_rate: int = BAUD_RATE,
        parity: Parity = Parity.EVEN,
        reply_timeout_s: float = REPLY_TIMEOUT_S,
    ) -> None:
        """Open the port with 8 data bits and 1 stop bit. Raises BusError when it cannot be opened."""
        self.responses = 0
        self._path = path
        self._client = ModbusSerialClient(
            path,
            framer=FramerType.RTU,
            baudrate=baud_rate,
            bytesize=8,
            parity=parity.value,
            stopbits=1,
            timeout=reply_timeout_s,
            retries=0,
        )
        if not self._client.connect():
            raise BusError(
                f"{path}: cannot be opened: plug in the RS-485 adapter, and add this user to group dialout"
            )

    def close(self) -> None:
        self._client.close()  # type: ignore[no-untyped-call]

    def watch(self, device_id: int, timeout_ms: int) -> None:
        """Set the drive's own watchdog (alarm 85h after `timeout_ms` without a request) and read it back."""
        self._write(device_id, COMMUNICATION_TIMEOUT, timeout_ms)
        kept = from_words(self._read(device_id, COMMUNICATION_TIMEOUT.address, 2))[0]
        if kept != timeout_ms:
            raise BusError(
                f"{self._name(device_id)} keeps {kept} ms as {COMMUNICATION_TIMEOUT.name}, not {timeout_ms}:"
                " set it with the maker's tool, or the drive would not stop when the host dies"
            )

    def move(self, device_id: int, direct_data: Sequence[int]) -> Sequence[int]:
        """Start the operation of 16 words of direct data; return the axis' motion registers."""
        return self._transact(
            device_id,
            lambda: self._client.readwrite_registers(
                read_address=az.MOTION_FIRST,
                read_count=az.MOTION_WORDS,
                write_address=DIRECT_DATA[0].address,
                values=list(direct_data),
                device_id=device_id,
            ),
        )

    def motion(self, device_id: int) -> Sequence[int]:
        """Read the motion registers of an axis without an order."""
        return self._read(device_id, az.MOTION_FIRST, az.MOTION_WORDS)

    def command(self, device_id: int, inputs: Input) -> None:
        """Set these bits of the driver input command, and no others."""
        self._write(device_id, INPUT_COMMAND, int(inputs))

    def health(self, device_id: int) -> AzHealth:
        """Read status and alarm."""
        words = self._read(
            device_id, OUTPUT_STATUS.address, PRESENT_ALARM.address + 2 - OUTPUT_STATUS.address
        )
        status, alarm = from_words(words)
        return AzHealth(AzStatus(status & 0xFFFF), alarm & 0xFF)

    def temperatures(self, device_id: int) -> AzTemperatures:
        """Read the temperatures of drive and motor."""
        first = DRIVER_TEMPERATURE.address
        driver, motor = from_words(self._read(device_id, first, MOTOR_TEMPERATURE.address + 2 - first))
        return AzTemperatures(
            driver_degC=round(driver * DRIVER_TEMPERATURE.scale, 1),
            motor_degC=round(motor * MOTOR_TEMPERATURE.scale, 1),
        )

    def value(self, device_id: int, register: AzRegister) -> float:
        """Read one quantity in its unit."""
        return from_words(self._read(device_id, register.address, 2))[0] * register.scale

    def _read(self, device_id: int, address: int, count: int) -> Sequence[int]:
        return self._transact(
            device_id,
            lambda: self._client.read_holding_registers(address, count=count, device_id=device_id),
        )

    def _write(self, device_id: int, register: AzRegister, value: int) -> None:
        words = to_words([value])
        self._transact(
            device_id, lambda: self._client.write_registers(register.address, words, device_id=device_id)
        )

    def _transact(self, device_id: int, request: Callable[[], Any]) -> Sequence[int]:
        """Send one request, never repeated, and return the registers of the response."""
        try:
            if not self._client.connected and not self._client.connect():
                raise BusError(f"{self._path}: the RS-485 adapter is lost: plug it in again")
            reply = request()
        except (ModbusException, OSError) as exc:
            raise BusError(f"{self._name(device_id)} does not respond: {exc}") from exc
        self.responses += 1
        if reply.isError():
            raise BusError(f"{self._name(device_id)} rejects the request: {reply}")
        return list(reply.registers)

    def _name(self, device_id: int) -> str:
        return f"AZ drive {device_id} on {self._path}"
