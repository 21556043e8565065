"""Text of an emergency: error codes of CiA 301 (7.2.7.1) and CiA 402, bits of the error register 1001h."""

from __future__ import annotations

from palpate_bus.decode.units import FINGERTIP
from palpate_edge.node.emergencies import Emergency

# CiA 301: mask, value, text; from special to general, the first match is used.
_CODES: tuple[tuple[int, int, str], ...] = (
    (0xFFFF, 0x8110, "CAN overrun, frames lost"),
    (0xFFFF, 0x8120, "CAN error passive"),
    (0xFFFF, 0x8130, "heartbeat or life guarding lost"),
    (0xFFFF, 0x8140, "recovered from bus-off"),
    (0xFFFF, 0x8150, "collision of CAN identifiers"),
    (0xFFFF, 0x8210, "PDO not processed, too short"),
    (0xFFFF, 0x8220, "PDO too long"),
    (0xFFFF, 0x8230, "multiplexed PDO not processed, destination not available"),
    (0xFFFF, 0x8240, "SYNC of an unexpected length"),
    (0xFFFF, 0x8250, "RPDO timed out"),
    (0xFF00, 0x0000, "error reset, or no error"),
    (0xFF00, 0x1000, "generic error"),
    (0xFF00, 0x2100, "current, device input side"),
    (0xFF00, 0x2200, "current inside the device"),
    (0xFF00, 0x2300, "current, device output side"),
    (0xF000, 0x2000, "current"),
    (0xFF00, 0x3100, "mains voltage"),
    (0xFF00, 0x3200, "voltage inside the device"),
    (0xFF00, 0x3300, "output voltage"),
    (0xF000, 0x3000, "voltage"),
    (0xFF00, 0x4100, "ambient temperature"),
    (0xFF00, 0x4200, "device temperature"),
    (0xFF00, 0x4300, "drive temperature"),
    (0xF000, 0x4000, "temperature"),
    (0xF000, 0x5000, "device hardware"),
    (0xFF00, 0x6100, "internal software"),
    (0xFF00, 0x6200, "user software"),
    (0xFF00, 0x6300, "data set"),
    (0xF000, 0x6000, "device software"),
    (0xFF00, 0x7100, "power"),
    (0xF000, 0x7000, "additional modules"),
    (0xFF00, 0x8100, "communication"),
    (0xFF00, 0x8200, "protocol error"),
    (0xFF00, 0x8300, "torque control"),
    (0xFF00, 0x8400, "speed control"),
    (0xFF00, 0x8600, "positioning"),
    (0xF000, 0x8000, "monitoring"),
    (0xF000, 0x9000, "external error"),
    (0xFF00, 0xF000, "additional functions"),
    (0xFF00, 0xFF00, "device specific"),
)

_REGISTER_BITS = (
    "generic",
    "current",
    "voltage",
    "temperature",
    "communication",
    "device profile",
    "reserved",
    "manufacturer",
)


def emcy_text(code: int, product: str = "") -> str:
    """Return the meaning of an error code; device-specific codes FFxxh are known for the fingertip only."""
    own = {int(emergency): emergency.name.lower().replace("_", " ") for emergency in Emergency}
    if product == FINGERTIP and code in own:
        return own[code]
    return next((text for mask, value, text in _CODES if code & mask == value), "unknown code")


def register_text(register: int) -> str:
    """Return the names of the bits set in 1001h."""
    return ", ".join(name for bit, name in enumerate(_REGISTER_BITS) if register >> bit & 1) or "none"
