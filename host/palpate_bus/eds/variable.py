"""Reader of one sub-index of an EDS file: name, type, access, default and limits (CiA 306-1, 4.6)."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_bus.eds.text import Findings, Section
from palpate_bus.eds.values import (
    DATA_TYPES,
    DOMAIN,
    FIRST_COMPLEX_TYPE,
    LAST_COMPLEX_TYPE,
    DataTypeInfo,
    Value,
    parse_integer,
    parse_value,
)

NODE_ID = 1
"""Formulas with $NODEID are evaluated for this node id; no rule depends on its value."""

ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")
MAX_NAME = 241
MAX_SUBINDEX = 0xFE


@dataclass(frozen=True, slots=True)
class Variable:
    """One sub-index as described in the file; missing or wrong entries are None or empty."""

    index: int
    subindex: int
    section: Section
    name: str
    data_type: int
    info: DataTypeInfo | None
    access: str
    default: Value | None
    mappable: bool

    @property
    def key(self) -> tuple[int, int]:
        return self.index, self.subindex

    @property
    def readable(self) -> bool:
        return self.access not in ("wo", "")

    @property
    def writable(self) -> bool:
        return self.access in ("wo", "rw", "rww", "rwr")

    @property
    def line(self) -> int:
        return self.section.line_of("DefaultValue")

    def number(self) -> int | None:
        """Return the default of an integer type, None for other types or without a default."""
        return self.default if isinstance(self.default, int) else None


Variables = dict[tuple[int, int], Variable]


def read_variable(index: int, sub: int, section: Section, object_type: int, findings: Findings) -> Variable:
    where = f"[{section.name}]"
    if sub or section.name.lower().endswith("sub0"):
        check_name(section, findings)
        if sub > MAX_SUBINDEX and sub != 0xFF:
            findings.error(section.line, where, "sub-index above FEh", "use 00h to FEh")
    data_type = _data_type(section, object_type, findings)
    info = DATA_TYPES.get(data_type)
    access = section.value("AccessType").lower()
    if access not in ACCESS_TYPES and object_type != 2:
        findings.error(
            section.line_of("AccessType"),
            where,
            f"AccessType is {section.value('AccessType')[:20]!r}" if access else "has no AccessType",
            f"use one of {', '.join(ACCESS_TYPES)}",
        )
        access = ""
    mapping = section.value("PDOMapping")
    mappable = _flag(section, "PDOMapping", findings)
    if mapping and mappable and info is not None and info.is_text:
        findings.error(
            section.line_of("PDOMapping"),
            where,
            f"{info.name} cannot be mapped into a PDO",
            "write PDOMapping=0",
        )
    default = _limited(section, info, findings)
    return Variable(
        index, sub, section, section.value("ParameterName"), data_type, info, access, default, mappable
    )


def _data_type(section: Section, object_type: int, findings: Findings) -> int:
    where = f"[{section.name}]"
    if object_type == 2 and not section.item("DataType"):
        return DOMAIN
    if not section.item("DataType"):
        findings.error(section.line, where, "has no DataType", "add one, such as DataType=0x0005 (UNSIGNED8)")
        return 0
    data_type = read_integer(section, "DataType", findings, 0)
    if data_type not in DATA_TYPES and not FIRST_COMPLEX_TYPE <= data_type <= LAST_COMPLEX_TYPE:
        findings.error(
            section.line_of("DataType"),
            where,
            f"DataType {section.value('DataType')[:20]!r} is not a data type of CiA 301",
            "use 0x0001 to 0x001B",
        )
    return data_type


def _limited(section: Section, info: DataTypeInfo | None, findings: Findings) -> Value | None:
    """Return the default after checking it against the data type and the limits."""
    values: dict[str, Value] = {}
    for key in ("LowLimit", "HighLimit", "DefaultValue"):
        text = section.value(key)
        if not text or info is None:
            continue
        if info.is_text and key != "DefaultValue":
            findings.warning(
                section.line_of(key), f"[{section.name}] {key}", f"{info.name} has no limits", "remove it"
            )
            continue
        try:
            values[key] = parse_value(info, text, NODE_ID)
        except (ValueError, OverflowError) as error:
            findings.error(
                section.line_of(key), f"[{section.name}] {key}", str(error), f"write a value of {info.name}"
            )
    low, high, default = (values.get(key) for key in ("LowLimit", "HighLimit", "DefaultValue"))
    where = f"[{section.name}]"
    if isinstance(low, int | float) and isinstance(high, int | float) and low > high:
        findings.error(
            section.line_of("LowLimit"), where, f"LowLimit {low} is above HighLimit {high}", "swap them"
        )
    elif isinstance(default, int | float):
        if isinstance(low, int | float) and default < low:
            findings.error(
                section.line_of("DefaultValue"),
                where,
                f"default {default} is below LowLimit {low}",
                "correct one of them",
            )
        if isinstance(high, int | float) and default > high:
            findings.error(
                section.line_of("DefaultValue"),
                where,
                f"default {default} is above HighLimit {high}",
                "correct one of them",
            )
    return default


def check_name(section: Section, findings: Findings) -> None:
    name = section.value("ParameterName")
    if not name:
        line = section.line_of("ParameterName")
        findings.error(line, f"[{section.name}]", "has no ParameterName", "add one")
    elif len(name) > MAX_NAME:
        findings.error(
            section.line_of("ParameterName"),
            f"[{section.name}]",
            f"ParameterName has {len(name)} characters",
            f"use at most {MAX_NAME}",
        )


def read_integer(section: Section, key: str, findings: Findings, otherwise: int) -> int:
    text = section.value(key)
    if not text:
        return otherwise
    try:
        return parse_integer(text)
    except ValueError as error:
        findings.error(section.line_of(key), f"[{section.name}] {key}", str(error), "write a number")
        return otherwise


def _flag(section: Section, key: str, findings: Findings) -> bool:
    number = read_integer(section, key, findings, 0)
    if number not in (0, 1):
        findings.error(section.line_of(key), f"[{section.name}] {key}", f"is {number}", "write 0 or 1")
    return bool(number)
