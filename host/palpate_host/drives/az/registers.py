"""Registers of the AZ drive as data (manual HM-60262E; every quantity is 32 bits, high word first).

The addresses up to 0x00FB are those that public drivers use; none has been confirmed on a drive yet, nor has
the temperatures' unit of 0.1 degC. COMMUNICATION_TIMEOUT is from the manual's table of Modbus parameters: the
port writes it and reads it back, so a drive with another register there is refused.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from palpate_edge.common.errors import BusError


@dataclass(frozen=True, slots=True)
class AzRegister:
    """One quantity: two words from `address` on; the raw value times `scale` is in `unit`."""

    address: int
    name: str
    unit: str = ""
    scale: float = 1.0


# Direct data operation: one write of all eight starts an operation according to TRIGGER.
DATA_NUMBER = AzRegister(0x0058, "direct data: operation data number")
OPERATION_TYPE = AzRegister(0x005A, "direct data: operation type")
POSITION = AzRegister(0x005C, "direct data: position", "step")
SPEED = AzRegister(0x005E, "direct data: speed", "Hz")
ACCELERATION = AzRegister(0x0060, "direct data: starting and changing rate", "kHz/s", 0.001)
DECELERATION = AzRegister(0x0062, "direct data: stopping rate", "kHz/s", 0.001)
OPERATING_CURRENT = AzRegister(0x0064, "direct data: operating current", "%", 0.1)
TRIGGER = AzRegister(0x0066, "direct data: trigger")
FORWARDING = AzRegister(0x0068, "direct data: forwarding destination")
DIRECT_DATA = (
    DATA_NUMBER,
    OPERATION_TYPE,
    POSITION,
    SPEED,
    ACCELERATION,
    DECELERATION,
    OPERATING_CURRENT,
    TRIGGER,
)

INPUT_COMMAND = AzRegister(0x007C, "driver input command")
OUTPUT_STATUS = AzRegister(0x007E, "driver output status")
PRESENT_ALARM = AzRegister(0x0080, "present alarm")
COMMAND_POSITION = AzRegister(0x00C6, "command position", "step")
FEEDBACK_POSITION = AzRegister(0x00CC, "feedback position", "step")
FEEDBACK_SPEED_RPM = AzRegister(0x00CE, "feedback speed", "r/min")
FEEDBACK_SPEED = AzRegister(0x00D0, "feedback speed", "Hz")
TORQUE = AzRegister(0x00D6, "torque monitor", "%", 0.1)
DRIVER_TEMPERATURE = AzRegister(0x00F8, "driver temperature", "degC", 0.1)
MOTOR_TEMPERATURE = AzRegister(0x00FA, "motor temperature", "degC", 0.1)
COMMUNICATION_TIMEOUT = AzRegister(0x138A, "communication timeout (Modbus)", "ms")


class OperationType(enum.IntEnum):
    """Operation types that a joint uses; a torque's sign is that of the speed, its size the current."""

    ABSOLUTE_POSITIONING = 1
    CONTINUOUS_SPEED = 16
    CONTINUOUS_TORQUE = 18


class Trigger(enum.IntEnum):
    """Values of TRIGGER: what its write starts."""

    OFF = 0
    ALL = 1


class Input(enum.IntFlag):
    """Bits of the driver input command."""

    START = 1 << 3
    ZHOME = 1 << 4
    STOP = 1 << 5
    FREE = 1 << 6
    ALM_RST = 1 << 7


class AzStatus(enum.IntFlag):
    """Bits of the driver output status; the others depend on the drive's assignment and are ignored."""

    HOME_END = 1 << 4
    READY = 1 << 5
    ALM_A = 1 << 7
    SYS_BSY = 1 << 8
    MOVE = 1 << 13
    IN_POS = 1 << 14


def to_words(values: Sequence[int]) -> list[int]:
    """Convert signed 32-bit values to pairs of 16-bit words, high word first. BusError when one does not
    fit."""
    try:
        packed = struct.pack(f">{len(values)}i", *values)
    except struct.error as exc:
        raise BusError(f"{list(values)} does not fit into 32-bit registers: {exc}") from exc
    return list(struct.unpack(f">{2 * len(values)}H", packed))


def from_words(words: Sequence[int]) -> list[int]:
    """Convert pairs of 16-bit words, high word first, to signed 32-bit values. BusError for half a value."""
    if len(words) % 2:
        raise BusError(f"{len(words)} registers are not whole 32-bit values")
    packed = struct.pack(f">{len(words)}H", *words)
    return list(struct.unpack(f">{len(words) // 2}i", packed))
