"""Units and meanings of raw values.

The EDS gives unit and decimals of a measured value in 6131h and 6132h (CiA 404; codes of CiA 303-2). Objects
of CiA 301 have the units of that standard. For palpate's EDS files, recognised by their ProductName, this
module contains the units given in the comments of those files; each axis of a drive has those of axis 0.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from palpate_bus.eds.cia402 import state_of
from palpate_bus.eds.cia402_axes import profile_key
from palpate_edge.common.contact_quantities import AI_INPUT, NOT_GIVEN, QUANTITIES
from palpate_edge.node.fingertip_objects import (
    BUS_CLOCK,
    CLOCK_STATES,
    TEMPERATURE,
    TEMPERATURE_UNKNOWN,
    ContactFlag,
    MethodCode,
)

FINGERTIP, JOINT_DRIVE, MULTI_AXIS = "palpate fingertip", "palpate joint drive", "palpate multi-axis drive"


@dataclass(frozen=True, slots=True)
class Unit:
    """Unit of an object: value = raw * factor. decimals: those of the displayed value."""

    name: str
    factor: float = 1.0
    decimals: int = 0

    def text(self, raw: float) -> str:
        """Return the value with its unit."""
        return f"{raw * self.factor:.{self.decimals}f} {self.name}".rstrip()


# CiA 303-2: SI prefixes by their exponent of ten, units by their code.
_PREFIXES = {0xFA: "u", 0xFD: "m", 0xFE: "c", 0xFF: "d", 0x00: "", 0x03: "k", 0x06: "M"}
_SYMBOLS = {
    0x01: "m",
    0x02: "kg",
    0x03: "s",
    0x04: "A",
    0x05: "K",
    0x10: "rad",
    0x20: "Hz",
    0x21: "N",
    0x22: "Pa",
    0x23: "J",
    0x24: "W",
    0x26: "V",
    0x2D: "degC",
    0x41: "deg",
}
_NEWTON_MILLIMETRE = 0xFD23_0000  # CiA 303-2 only has the joule; for a torsion this is the newton metre

_COMMUNICATION: dict[tuple[int, int], Unit] = {
    (0x1006, 0): Unit("us"),
    (0x1007, 0): Unit("us"),
    (0x100C, 0): Unit("ms"),
    (0x1013, 0): Unit("us"),
    (0x1015, 0): Unit("ms", 0.1, 1),
    (0x1017, 0): Unit("ms"),
}
_PRODUCT: dict[str, dict[tuple[int, int], Unit]] = {
    FINGERTIP: {
        (0x2012, 0): Unit("us"),
        (0x2014, 0): Unit("us"),
        (0x2020, 0): Unit("degC", 0.1, 1),
        (0x2024, 0): Unit("px", 0.01, 2),
        (0x2031, 0): Unit("us"),
        (0x2042, 2): Unit("ppm", 0.001, 3),
        (0x2042, 3): Unit("us"),
    },
    JOINT_DRIVE: {
        (0x6064, 0): Unit("deg", 0.001, 3),
        (0x606C, 0): Unit("deg/s", 0.001, 3),
        (0x6071, 0): Unit("%", 0.1, 1),
        (0x6072, 0): Unit("%", 0.1, 1),
        (0x6076, 0): Unit("mN m"),
        (0x6077, 0): Unit("%", 0.1, 1),
    },
}


def si_unit(code: int, decimals: int) -> Unit | None:
    """Return the unit for the values of 6131h and 6132h, None for a code that is not in the tables."""
    prefix, symbol = _PREFIXES.get(code >> 24), _SYMBOLS.get(code >> 16 & 0xFF)
    if code & 0xFFFF or prefix is None or symbol is None:
        return None
    name = "N mm" if code == _NEWTON_MILLIMETRE else prefix + symbol
    return Unit(name, 10.0**-decimals, decimals)


def unit_of(product: str, index: int, subindex: int) -> Unit | None:
    """Return the unit of an object without 6131h, None when it has none."""
    if index in range(0x1400, 0x1600) or index in range(0x1800, 0x1A00):
        return {3: Unit("ms", 0.1, 1), 5: Unit("ms")}.get(subindex)
    product, key = _profile_object(product, (index, subindex))
    return _COMMUNICATION.get(key) or _PRODUCT.get(product, {}).get(key)


def _profile_object(product: str, key: tuple[int, int]) -> tuple[str, tuple[int, int]]:
    """Return the object of the joint drive that an object of an axis corresponds to."""
    return (JOINT_DRIVE, profile_key(key)) if product == MULTI_AXIS else (product, key)


def _flags(raw: int) -> str:
    names = ((flag.name or "").lower().replace("_", " ") for flag in ContactFlag if raw & flag)
    return " ".join(names) or "none"


def _method(raw: int) -> str:
    return next((method.name.lower() for method in MethodCode if method == raw), "")


def _clock_state(raw: int) -> str:
    return next((state.value for state, code in CLOCK_STATES.items() if code == raw), "")


def _drive_state(raw: int) -> str:
    state = state_of(raw)
    return "not a state of CiA 402" if state is None else state.value


def _mode(raw: int) -> str:
    modes = {
        1: "profile position",
        3: "profile velocity",
        4: "profile torque",
        8: "cyclic synchronous position",
    }
    return (modes | {9: "cyclic synchronous velocity", 10: "cyclic synchronous torque"}).get(raw, "")


_CONTROLWORDS = ((0x80, 0x80, "fault reset"), (0x87, 0x06, "shutdown"), (0x8F, 0x07, "switch on"))
_MORE_CONTROLWORDS = ((0x82, 0x00, "disable voltage"), (0x86, 0x02, "quick stop"), (0x8F, 0x0F, "enable"))


def _controlword(raw: int) -> str:
    """Return the command of a controlword (CiA 402)."""
    words = (*_CONTROLWORDS, *_MORE_CONTROLWORDS)
    return next((text for mask, value, text in words if raw & mask == value), "")


_MEANINGS: dict[str, dict[tuple[int, int], Callable[[int], str]]] = {
    FINGERTIP: {(0x2000, 0): _method, (0x2010, 0): _flags, (BUS_CLOCK, 1): _clock_state},
    JOINT_DRIVE: {
        (0x6040, 0): _controlword,
        (0x6041, 0): _drive_state,
        (0x6060, 0): _mode,
        (0x6061, 0): _mode,
    },
}


_UNKNOWN: dict[str, dict[tuple[int, int], tuple[int, str]]] = {
    FINGERTIP: {
        (TEMPERATURE, 0): (TEMPERATURE_UNKNOWN, "unknown"),
        **{(AI_INPUT, quantity.channel): (NOT_GIVEN, "not given") for quantity in QUANTITIES},
    }
}


def unknown_text(product: str, index: int, subindex: int, raw: int) -> str:
    """Return the text for a raw value that means "no value"; empty for any other."""
    known = _UNKNOWN.get(product, {}).get((index, subindex))
    return known[1] if known is not None and known[0] == raw else ""


def meaning_of(product: str, index: int, subindex: int, raw: int) -> str:
    """Return the meaning of a raw value as text; empty for a plain number."""
    product, key = _profile_object(product, (index, subindex))
    known = _MEANINGS.get(product, {}).get(key)
    return known(raw) if known else ""
