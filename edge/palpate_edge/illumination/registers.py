"""The illumination controller's registers.

Written by firmware/illumination/generate.py from registers.toml: edit registers.toml.
"""

from __future__ import annotations

import enum

IDENTITY = 0x5041
VERSION = 0x0002
I2C_ADDRESS = 0x002A
MAP_CRC = 0x3268


class LightRegister(enum.IntEnum):
    """SMBus command of each 16-bit register."""

    IDENTITY = 0x00
    VERSION = 0x01
    MAP_CRC = 0x02
    LEVEL = 0x03
    SOFT_START = 0x04
    WATCHDOG = 0x05
    STROBE_DELAY = 0x06
    STROBE_WIDTH = 0x07
    DERATE_START = 0x08
    CUT_OFF = 0x09
    LED_TEMPERATURE = 0x10
    SILICONE_TEMPERATURE = 0x11
    DUTY = 0x12
    FAULTS = 0x13
    FAULT_CLEAR = 0x14
    UPTIME = 0x15
    TRIGGERS = 0x16
    PEC_ERRORS = 0x17
    PRESENT = 0x18


class Fault(enum.IntFlag):
    """Bits of FAULTS and FAULT_CLEAR."""

    OVER_TEMPERATURE = 0x01
    LED_SENSOR = 0x02
    SILICONE_SENSOR = 0x04
    BOARD_SILENT = 0x08
    RESET_WATCHDOG = 0x10
    RESET_BROWN_OUT = 0x20


RANGES = {
    LightRegister.LEVEL: (0, 255),
    LightRegister.SOFT_START: (0, 5000),
    LightRegister.WATCHDOG: (100, 10000),
    LightRegister.STROBE_DELAY: (0, 255),
    LightRegister.STROBE_WIDTH: (0, 255),
    LightRegister.DERATE_START: (300, 900),
    LightRegister.CUT_OFF: (400, 950),
    LightRegister.FAULT_CLEAR: (0, 255),
}
"""Least and greatest value of each register that can be written."""

SIGNED = frozenset({LightRegister.LED_TEMPERATURE, LightRegister.SILICONE_TEMPERATURE})
