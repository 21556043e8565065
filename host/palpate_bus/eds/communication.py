"""Checks of an EDS file's communication objects against CiA 301: types, access, COB-IDs."""

from __future__ import annotations

from collections.abc import Iterator

from palpate_bus.eds.objects import OBJECT_TYPES
from palpate_bus.eds.pdo import NOT_VALID, PDO_KINDS, PDOS, check_pdo, dummies_of, pdo_numbers
from palpate_bus.eds.text import Findings, Section
from palpate_bus.eds.values import UNSIGNED8, UNSIGNED16, UNSIGNED32, VISIBLE_STRING
from palpate_bus.eds.variable import NODE_ID, Variable, Variables

CAN_ID_MASK = 0x7FF
EXTENDED = 1 << 29

READ_ONLY = ("ro", "const")

# CiA 301, object dictionary: index and sub-index -> data type. -1 stands for every sub-index above 0.
_TYPES: dict[tuple[int, int], int] = {
    (0x1000, 0): UNSIGNED32,
    (0x1001, 0): UNSIGNED8,
    (0x1002, 0): UNSIGNED32,
    (0x1003, -1): UNSIGNED32,
    (0x1005, 0): UNSIGNED32,
    (0x1006, 0): UNSIGNED32,
    (0x1007, 0): UNSIGNED32,
    (0x1008, 0): VISIBLE_STRING,
    (0x1009, 0): VISIBLE_STRING,
    (0x100A, 0): VISIBLE_STRING,
    (0x100C, 0): UNSIGNED16,
    (0x100D, 0): UNSIGNED8,
    (0x1010, -1): UNSIGNED32,
    (0x1011, -1): UNSIGNED32,
    (0x1012, 0): UNSIGNED32,
    (0x1013, 0): UNSIGNED32,
    (0x1014, 0): UNSIGNED32,
    (0x1015, 0): UNSIGNED16,
    (0x1016, -1): UNSIGNED32,
    (0x1017, 0): UNSIGNED16,
    (0x1018, -1): UNSIGNED32,
    (0x1019, 0): UNSIGNED8,
    (0x1029, -1): UNSIGNED8,
}
_ARRAYS = (0x1003, 0x1010, 0x1011, 0x1016, 0x1029)
_RECORDS = (0x1018, *range(0x1200, 0x1C00))
_NOT_WRITABLE = {(0x1000, 0), (0x1001, 0), (0x1002, 0), *((0x1018, sub) for sub in range(5))}
_PDO_SUBS = {1: UNSIGNED32, 2: UNSIGNED8, 3: UNSIGNED16, 5: UNSIGNED16, 6: UNSIGNED8}

RESTRICTED = (range(1), range(1, 0x80), range(0x101, 0x181), range(0x6E0, 0x700), range(0x780, 0x800))
"""CiA 301, restricted CAN-IDs, which no PDO, SYNC, TIME or EMCY may use.

The identifiers of SDO and error control are checked as duplicates instead.
"""


def check_communication(
    sections: dict[str, Section], variables: Variables, granularity: int, findings: Findings
) -> None:
    """Apply every rule of this module. granularity: of PDO mapping, in bits; 0 for any."""
    dummies = dummies_of(sections.get("dummyusage"), findings)
    for indices, object_type in ((_ARRAYS, 8), (_RECORDS, 9)):
        for index in indices:
            _check_object_type(sections.get(f"{index:04x}"), object_type, findings)
    for variable in variables.values():
        _check_type(variable, findings)
    if (0x1017, 0) not in variables and (0x100C, 0) not in variables:
        findings.error(
            0, "[1017]", "neither heartbeat (1017h) nor node guarding (100Ch)", "describe 1017h, UNSIGNED16"
        )
    for kind in PDO_KINDS:
        for number in pdo_numbers(variables, kind):
            check_pdo(kind, number, variables, dummies, granularity, findings)
    _check_cob_ids(variables, findings)


def _check_object_type(section: Section | None, object_type: int, findings: Findings) -> None:
    found = section.value("ObjectType").lower() if section else ""
    if section is not None and found not in ("", f"0x{object_type}", str(object_type), f"0x0{object_type}"):
        kind = OBJECT_TYPES[object_type]
        findings.error(
            section.line_of("ObjectType"),
            f"[{section.name}]",
            f"ObjectType {found} is not that of CiA 301, {kind}",
            f"write ObjectType=0x{object_type}",
        )


def _check_type(variable: Variable, findings: Findings) -> None:
    index, sub = variable.key
    expected = _TYPES.get((index, sub)) or (_TYPES.get((index, -1)) if sub else None)
    if any(0 <= index - kind.communication < PDOS for kind in PDO_KINDS):
        expected = _PDO_SUBS.get(sub)
    elif any(0 <= index - kind.mapping < PDOS for kind in PDO_KINDS):
        expected = UNSIGNED32 if sub else UNSIGNED8
    where = f"[{variable.section.name}]"
    if expected is not None and variable.data_type not in (expected, 0):
        findings.error(
            variable.section.line_of("DataType"),
            where,
            f"DataType {variable.section.value('DataType')} is not that of CiA 301",
            f"write DataType=0x{expected:04X}",
        )
    if variable.key in _NOT_WRITABLE and variable.writable:
        findings.error(
            variable.section.line_of("AccessType"),
            where,
            "is writable, CiA 301 requires read-only",
            "write AccessType=ro",
        )


def _cob_ids(variables: Variables) -> Iterator[tuple[str, Variable]]:
    """Yield (label, variable) of every object that contains a COB-ID."""
    names = {(0x1005, 0): "SYNC", (0x1012, 0): "TIME", (0x1014, 0): "EMCY"}
    for key, variable in variables.items():
        index, sub = key
        if key in names:
            yield names[key], variable
        elif index in range(0x1200, 0x1280) and sub in (1, 2):
            yield f"SDO server {index - 0x1200 + 1}", variable
        elif sub == 1:
            for kind in PDO_KINDS:
                if 0 <= index - kind.communication < PDOS:
                    yield f"{kind.label} {index - kind.communication + 1}", variable


def _check_cob_ids(variables: Variables, findings: Findings) -> None:
    used = {0x700 + NODE_ID: ("error control", 0)}
    for label, variable in _cob_ids(variables):
        value = variable.number()
        if value is None or value & NOT_VALID:
            continue
        where = f"[{variable.section.name}]"
        can_id = value & CAN_ID_MASK
        if value & EXTENDED:
            findings.warning(variable.line, where, f"{label} has a 29-bit identifier", "use an 11-bit one")
            continue
        if any(can_id in ids for ids in RESTRICTED):
            findings.error(
                variable.line, where, f"{label} has the restricted identifier {can_id:03X}h", "use another"
            )
        first, line = used.setdefault(can_id, (label, variable.line))
        if first != label:
            place = f" (line {line})" if line else ""
            findings.error(
                variable.line,
                where,
                f"{label} has the identifier of {first}{place}, {can_id:03X}h at node {NODE_ID}",
                "give it another or set bit 31",
            )
