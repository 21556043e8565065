"""The objects of an EDS file (CiA 306-1, 4.6): sections become variables, with findings on the way."""

from __future__ import annotations

import re
from dataclasses import dataclass

from palpate_host.bus.eds_text import Findings, Section
from palpate_host.bus.eds_values import (
    DATA_TYPES,
    DOMAIN,
    FIRST_COMPLEX_TYPE,
    LAST_COMPLEX_TYPE,
    UNSIGNED8,
    DataTypeInfo,
    Value,
    parse_integer,
    parse_value,
)

NODE_ID = 1
"""Formulas with $NODEID are worked out for this node; no rule depends on which one."""

ACCESS_TYPES = ("ro", "wo", "rw", "rwr", "rww", "const")
OBJECT_TYPES = {0: "NULL", 2: "DOMAIN", 5: "DEFTYPE", 6: "DEFSTRUCT", 7: "VAR", 8: "ARRAY", 9: "RECORD"}
_WITH_SUBS = (8, 9, 6)
MAX_NAME = 241
MAX_SUBINDEX = 0xFE

OBJECT_SECTION = re.compile(r"[0-9a-f]{4}")
SUB_SECTION = re.compile(r"(?P<index>[0-9a-f]{4})sub(?P<sub>[0-9a-f]{1,2})")


@dataclass(frozen=True, slots=True)
class Variable:
    """One sub-index as the file describes it; what is missing or wrong is None or empty."""

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
        """The default of an integer type."""
        return self.default if isinstance(self.default, int) else None


Variables = dict[tuple[int, int], Variable]


def read_objects(sections: dict[str, Section], findings: Findings) -> Variables:
    """Every variable by (index, sub-index)."""
    variables: Variables = {}
    subs: dict[int, dict[int, Section]] = {}
    for name, section in sections.items():
        match = SUB_SECTION.fullmatch(name)
        if match:
            subs.setdefault(int(match["index"], 16), {})[int(match["sub"], 16)] = section
    for name, section in sections.items():
        if OBJECT_SECTION.fullmatch(name):
            index = int(name, 16)
            variables |= _object(index, section, subs.pop(index, {}), findings)
    for index, orphans in subs.items():
        for section in orphans.values():
            findings.error(
                section.line,
                f"[{section.name}]",
                f"there is no section [{index:04X}] it belongs to",
                "add the object's section or remove this one",
            )
    return variables


def _object(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    where = f"[{section.name}]"
    _check_name(section, findings)
    object_type = 7  # CiA 306-1: VAR when the key is missing
    if section.item("ObjectType"):
        object_type = _integer(section, "ObjectType", findings, -1)
        if object_type not in OBJECT_TYPES:
            names = ", ".join(f"0x{code:X} {name}" for code, name in OBJECT_TYPES.items())
            findings.error(
                section.line_of("ObjectType"), where, "ObjectType is no object code", f"use one of {names}"
            )
            object_type = 9 if subs else 7
    if object_type not in _WITH_SUBS:
        if subs:
            findings.error(
                section.line_of("ObjectType"),
                where,
                f"is a {OBJECT_TYPES[object_type]} and has sub-indices",
                "make it ARRAY (0x8) or RECORD (0x9), or remove them",
            )
        if object_type in (0, 5):
            return {}
        variable = _variable(index, 0, section, object_type, findings)
        return {variable.key: variable}
    if section.item("CompactSubObj"):
        return _compact(index, section, subs, findings)
    return _container(index, section, subs, findings)


def _container(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    where = f"[{section.name}]"
    variables = {(index, sub): _variable(index, sub, part, 7, findings) for sub, part in sorted(subs.items())}
    count = _integer(section, "SubNumber", findings, len(subs))
    if not section.item("SubNumber"):
        findings.error(section.line, where, "has no SubNumber", f"add SubNumber={len(subs)}")
    elif count != len(subs):
        findings.error(
            section.line_of("SubNumber"),
            where,
            f"SubNumber is {count}, {len(subs)} sub-indices are described",
            f"write SubNumber={len(subs)} or describe the others",
        )
    highest = variables.get((index, 0))
    if highest is None:
        findings.error(section.line, where, "sub-index 0 is missing", f"add [{index:04X}sub0] as UNSIGNED8")
        return variables
    if highest.data_type != UNSIGNED8:
        findings.error(
            highest.section.line_of("DataType"),
            f"[{highest.section.name}]",
            "is not UNSIGNED8",
            "write 0x0005",
        )
    told = highest.number()
    is_mapping = index in range(0x1600, 0x1800) or index in range(0x1A00, 0x1C00)
    grows = is_mapping or index == 0x1003  # their sub-index 0 counts what is in use
    if told is not None and told != max(subs) and not (grows and told <= max(subs)):
        findings.error(
            highest.line,
            f"[{highest.section.name}]",
            f"says {told}, the highest sub-index described is {max(subs)}",
            f"write DefaultValue={max(subs)} or describe the others",
        )
    return variables


def _compact(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    """CiA 306-1: one description for sub-indices 1 to CompactSubObj."""
    count = _integer(section, "CompactSubObj", findings, 0)
    if not 0 < count <= MAX_SUBINDEX + 1:
        findings.error(
            section.line_of("CompactSubObj"), f"[{section.name}]", f"CompactSubObj is {count}", "use 1 to 254"
        )
        count = max(0, min(count, MAX_SUBINDEX))
    described = _variable(index, 1, section, 7, findings)
    variables = {
        (index, sub): Variable(
            index,
            sub,
            section,
            described.name,
            described.data_type,
            described.info,
            described.access,
            described.default,
            described.mappable,
        )
        for sub in range(1, count + 1)
    }
    for sub, part in subs.items():
        variables[index, sub] = _variable(index, sub, part, 7, findings)
    return variables


def _variable(index: int, sub: int, section: Section, object_type: int, findings: Findings) -> Variable:
    where = f"[{section.name}]"
    if sub or section.name.lower().endswith("sub0"):
        _check_name(section, findings)
        if sub > MAX_SUBINDEX and sub != 0xFF:
            findings.error(section.line, where, "sub-index above FEh", "use 0 to FE")
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
            section.line_of("PDOMapping"), where, f"a {info.name} cannot be in a PDO", "write PDOMapping=0"
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
    data_type = _integer(section, "DataType", findings, 0)
    if data_type not in DATA_TYPES and not FIRST_COMPLEX_TYPE <= data_type <= LAST_COMPLEX_TYPE:
        findings.error(
            section.line_of("DataType"),
            where,
            f"DataType {section.value('DataType')[:20]!r} is none of CiA 301",
            "use 0x0001 to 0x001B",
        )
    return data_type


def _limited(section: Section, info: DataTypeInfo | None, findings: Findings) -> Value | None:
    """The default, checked against the data type and the limits."""
    values: dict[str, Value] = {}
    for key in ("LowLimit", "HighLimit", "DefaultValue"):
        text = section.value(key)
        if not text or info is None:
            continue
        if info.is_text and key != "DefaultValue":
            findings.warning(
                section.line_of(key), f"[{section.name}] {key}", f"a {info.name} has no limits", "remove it"
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
            section.line_of("LowLimit"), where, f"LowLimit {low} is above HighLimit {high}", "exchange them"
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


def _check_name(section: Section, findings: Findings) -> None:
    name = section.value("ParameterName")
    if not name:
        line = section.line_of("ParameterName")
        findings.error(line, f"[{section.name}]", "has no ParameterName", "name it")
    elif len(name) > MAX_NAME:
        findings.error(
            section.line_of("ParameterName"),
            f"[{section.name}]",
            f"ParameterName has {len(name)} characters",
            f"use at most {MAX_NAME}",
        )


def _integer(section: Section, key: str, findings: Findings, otherwise: int) -> int:
    text = section.value(key)
    if not text:
        return otherwise
    try:
        return parse_integer(text)
    except ValueError as error:
        findings.error(section.line_of(key), f"[{section.name}] {key}", str(error), "write a number")
        return otherwise


def _flag(section: Section, key: str, findings: Findings) -> bool:
    number = _integer(section, key, findings, 0)
    if number not in (0, 1):
        findings.error(section.line_of(key), f"[{section.name}] {key}", f"is {number}", "write 0 or 1")
    return bool(number)
