"""Names of the AZ drive's alarm codes (manual HM-60262E, table of alarms)."""

from __future__ import annotations

NAMES = {
    0x10: "excessive position deviation",
    0x20: "overcurrent",
    0x21: "main circuit overheat",
    0x22: "overvoltage",
    0x23: "main power supply off",
    0x25: "undervoltage",
    0x26: "motor overheat",
    0x28: "sensor error",
    0x2A: "absolute sensor communication error",
    0x30: "overload",
    0x31: "overspeed",
    0x33: "absolute position error",
    0x41: "memory error",
    0x42: "initial sensor error",
    0x44: "absolute sensor memory error",
    0x45: "motor combination error",
    0x4A: "homing incomplete",
    0x60: "both limit sensors active",
    0x61: "limit sensors reversed",
    0x62: "homing operation error",
    0x66: "hardware overtravel",
    0x67: "software overtravel",
    0x68: "power removal input",
    0x6A: "homing offset error",
    0x6D: "mechanical overtravel",
    0x70: "operation data error",
    0x71: "electronic gear setting error",
    0x72: "wrap setting error",
    0x81: "network bus error",
    0x84: "RS-485 communication error",
    0x85: "RS-485 communication timeout",
    0xF0: "processor error",
}
"""Alarm code -> name."""

COMMUNICATION_TIMEOUT = 0x85


def text(code: int) -> str:
    """Return the alarm for people: code and name, or a reference to the manual for a code without a name."""
    name = NAMES.get(code)
    return f"alarm {code:02X}h" + (f" ({name})" if name else " (see the manual)")
