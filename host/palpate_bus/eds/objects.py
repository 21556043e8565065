"""Objects of an EDS file (CiA 306-1, 4.6): conversion of sections to variables, with findings."""

from __future__ import annotations

import re
from dataclasses import replace

from palpate_bus.eds.text import Findings, Section
from palpate_bus.eds.values import UNSIGNED8
from palpate_bus.eds.variable import (
    MAX_SUBINDEX,
    Variables,
    check_name,
    read_integer,
    read_variable,
)

OBJECT_TYPES = {0: "NULL", 2: "DOMAIN", 5: "DEFTYPE", 6: "DEFSTRUCT", 7: "VAR", 8: "ARRAY", 9: "RECORD"}
_WITH_SUBS = (8, 9, 6)
OBJECT_SECTION = re.compile(r"[0-9a-f]{4}")
SUB_SECTION = re.compile(r"(?P<index>[0-9a-f]{4})sub(?P<sub>[0-9a-f]{1,2})")


def read_objects(sections: dict[str, Section], findings: Findings) -> Variables:
    """Return every variable by (index, sub-index)."""
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
                f"the section [{index:04X}] of its object is missing",
                "add the object's section or remove this one",
            )
    return variables


def _object(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    where = f"[{section.name}]"
    check_name(section, findings)
    object_type = 7  # CiA 306-1: VAR when the key is missing
    if section.item("ObjectType"):
        object_type = read_integer(section, "ObjectType", findings, -1)
        if object_type not in OBJECT_TYPES:
            names = ", ".join(f"0x{code:X} {name}" for code, name in OBJECT_TYPES.items())
            findings.error(
                section.line_of("ObjectType"),
                where,
                "ObjectType is not an object code",
                f"use one of {names}",
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
        variable = read_variable(index, 0, section, object_type, findings)
        return {variable.key: variable}
    if section.item("CompactSubObj"):
        return _compact(index, section, subs, findings)
    return _container(index, section, subs, findings)


def _container(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    where = f"[{section.name}]"
    variables = {
        (index, sub): read_variable(index, sub, part, 7, findings) for sub, part in sorted(subs.items())
    }
    count = read_integer(section, "SubNumber", findings, len(subs))
    if not section.item("SubNumber"):
        findings.error(section.line, where, "has no SubNumber", f"add SubNumber={len(subs)}")
    elif count != len(subs):
        findings.error(
            section.line_of("SubNumber"),
            where,
            f"SubNumber is {count}, but {len(subs)} sub-indices are described",
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
            "write DataType=0x0005",
        )
    declared = highest.number()
    is_mapping = index in range(0x1600, 0x1800) or index in range(0x1A00, 0x1C00)
    counts_used = is_mapping or index == 0x1003  # sub-index 0 is the number of entries in use
    if declared is not None and declared != max(subs) and not (counts_used and declared <= max(subs)):
        findings.error(
            highest.line,
            f"[{highest.section.name}]",
            f"is {declared}, but the highest described sub-index is {max(subs)}",
            f"write DefaultValue={max(subs)} or describe the others",
        )
    return variables


def _compact(index: int, section: Section, subs: dict[int, Section], findings: Findings) -> Variables:
    """Return the sub-indices 1 to CompactSubObj, which share one description (CiA 306-1)."""
    count = read_integer(section, "CompactSubObj", findings, 0)
    if not 0 < count <= MAX_SUBINDEX + 1:
        findings.error(
            section.line_of("CompactSubObj"), f"[{section.name}]", f"CompactSubObj is {count}", "use 1 to 254"
        )
        count = max(0, min(count, MAX_SUBINDEX))
    described = read_variable(index, 1, section, 7, findings)
    variables = {(index, sub): replace(described, subindex=sub) for sub in range(1, count + 1)}
    for sub, part in subs.items():
        variables[index, sub] = read_variable(index, sub, part, 7, findings)
    return variables
