"""One RS-485 port with the axes on it: Modbus RTU in, joint motion out. The only I/O of the AZ drives.

An axis costs one transaction a round: function 17h writes its direct data and reads its motion. Nothing is
ever repeated: what a lost answer was about is overtaken by the next round's fresh order, and a trigger that
was carried out twice would move the joint twice. Status and alarm, or the temperatures, of one axis a round
are read in turn.
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
    """As the drives are set; even when they come from the maker. A pseudo terminal knows none."""

    EVEN = "E"
    NONE = "N"
    ODD = "O"


@dataclass(frozen=True, slots=True)
class AzHealth:
    """What an axis says of itself: output status bits and the code of the present alarm, 0 for none."""

    status: AzStatus
    alarm: int


class AzPort:
    """The axes of one port; every call is one transaction and raises BusError when it fails.

    answers: replies that came since the port was opened, refusals too.
    """

    def __init__(
        self,
        path: str,
        baud_rate: int = BAUD_RATE,
        parity: Parity = Parity.EVEN,
        reply_timeout_s: float = REPLY_TIMEOUT_S,
    ) -> None:
        """Open the port with 8 data bits and 1 stop bit; BusError when it cannot be."""
        self.answers = 0
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
            raise BusError(f"{path}: cannot be opened: is the RS-485 adapter there, and yours (dialout)?")

    def close(self) -> None:
        self._client.close()  # type: ignore[no-untyped-call]

    def watch(self, device_id: int, timeout_ms: int) -> None:
        """Set the drive's own watchdog (alarm 85h after `timeout_ms` without us) and read it back."""
        self._write(device_id, COMMUNICATION_TIMEOUT, timeout_ms)
        kept = from_words(self._read(device_id, COMMUNICATION_TIMEOUT.address, 2))[0]
        if kept != timeout_ms:
            raise BusError(
                f"{self._name(device_id)} keeps {kept} ms as {COMMUNICATION_TIMEOUT.name}, not {timeout_ms}:"
                " set it with the maker's tool; the drive would not stop when the host dies"
            )

    def move(self, device_id: int, direct_data: Sequence[int]) -> Sequence[int]:
        """Start the operation of 16 words of direct data; the axis' motion registers."""
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
        """The motion registers of an axis that is asked nothing."""
        return self._read(device_id, az.MOTION_FIRST, az.MOTION_WORDS)

    def command(self, device_id: int, inputs: Input) -> None:
        """Hold these bits of the driver input command, and no others."""
        self._write(device_id, INPUT_COMMAND, int(inputs))

    def health(self, device_id: int) -> AzHealth:
        """Status and alarm."""
        words = self._read(
            device_id, OUTPUT_STATUS.address, PRESENT_ALARM.address + 2 - OUTPUT_STATUS.address
        )
        status, alarm = from_words(words)
        return AzHealth(AzStatus(status & 0xFFFF), alarm & 0xFF)

    def temperatures(self, device_id: int) -> AzTemperatures:
        """Of drive and motor."""
        first = DRIVER_TEMPERATURE.address
        driver, motor = from_words(self._read(device_id, first, MOTOR_TEMPERATURE.address + 2 - first))
        return AzTemperatures(
            driver_degC=round(driver * DRIVER_TEMPERATURE.scale, 1),
            motor_degC=round(motor * MOTOR_TEMPERATURE.scale, 1),
        )

    def value(self, device_id: int, register: AzRegister) -> float:
        """One quantity in its unit."""
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
        """The registers of the reply, once and never again."""
        try:
            if not self._client.connected and not self._client.connect():
                raise BusError(f"{self._path}: the RS-485 adapter is gone: plug it in again")
            reply = request()
        except (ModbusException, OSError) as exc:
            raise BusError(f"{self._name(device_id)} does not answer: {exc}") from exc
        self.answers += 1
        if reply.isError():
            raise BusError(f"{self._name(device_id)} refuses: {reply}")
        return list(reply.registers)

    def _name(self, device_id: int) -> str:
        return f"AZ drive {device_id} on {self._path}"
