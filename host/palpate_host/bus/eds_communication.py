"""What CiA 301 says of the communication objects an EDS file describes: types, access, COB-IDs, PDOs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from palpate_host.bus.eds_objects import NODE_ID, OBJECT_TYPES, Variable, Variables
from palpate_host.bus.eds_text import Findings, Section
from palpate_host.bus.eds_values import (
    UNSIGNED8,
    UNSIGNED16,
    UNSIGNED32,
    VISIBLE_STRING,
    parse_integer,
)

CAN_ID_MASK = 0x7FF
NOT_VALID, EXTENDED = 1 << 31, 1 << 29
MAX_PDO_BITS = 64
MAX_MAPPED = 64

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
"""CiA 301, restricted CAN-IDs: no PDO, SYNC, TIME or EMCY may take them (SDO's and error control's own
are checked as duplicates)."""


@dataclass(frozen=True, slots=True)
class PdoKind:
    """TPDO or RPDO: where its parameters lie, and which access its objects need."""

    label: str
    communication: int
    mapping: int
    count_key: str


TPDO = PdoKind("TPDO", 0x1800, 0x1A00, "NrOfTXPDO")
RPDO = PdoKind("RPDO", 0x1400, 0x1600, "NrOfRXPDO")
PDO_KINDS = (TPDO, RPDO)
PDOS = 512


def check_communication(
    sections: dict[str, Section], variables: Variables, granularity: int, findings: Findings
) -> None:
    """Every rule of this file. granularity: of PDO mapping in bits, 0: any."""
    dummies = _dummies_of(sections.get("dummyusage"), findings)
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
            _check_pdo(kind, number, variables, dummies, granularity, findings)
    _check_cob_ids(variables, findings)


def pdo_numbers(variables: Variables, kind: PdoKind) -> list[int]:
    """The PDOs that have communication or mapping parameters, 1-based."""
    numbers = {index - base + 1 for index, _ in variables for base in (kind.communication, kind.mapping)}
    return sorted(number for number in numbers if 1 <= number <= PDOS)


def _check_object_type(section: Section | None, object_type: int, findings: Findings) -> None:
    told = section.value("ObjectType").lower() if section else ""
    if section is not None and told not in ("", f"0x{object_type}", str(object_type), f"0x0{object_type}"):
        kind = OBJECT_TYPES[object_type]
        findings.error(
            section.line_of("ObjectType"),
            f"[{section.name}]",
            f"ObjectType {told} is not that of CiA 301, {kind}",
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
            variable.section.line_of("AccessType"), where, "is writable, CiA 301 says read only", "write ro"
        )


def _check_pdo(
    kind: PdoKind,
    number: int,
    variables: Variables,
    dummies: set[int],
    granularity: int,
    findings: Findings,
) -> None:
    communication, mapping = kind.communication + number - 1, kind.mapping + number - 1
    label = f"{kind.label} {number}"
    cob_id, transmission = variables.get((communication, 1)), variables.get((communication, 2))
    for sub, what in ((1, "COB-ID"), (2, "transmission type")):
        if (communication, sub) not in variables:
            findings.error(
                0,
                label,
                f"{communication:04X}h:{sub:02X} ({what}) is missing",
                f"describe [{communication:04X}sub{sub}]",
            )
    count = variables.get((mapping, 0))
    if count is None:
        findings.error(0, label, f"has no mapping parameter {mapping:04X}h", f"describe [{mapping:04X}]")
        return
    if transmission is not None:
        _check_transmission(label, transmission, kind, findings)
    told = count.number() or 0
    if not 0 <= told <= MAX_MAPPED:
        if not (kind is RPDO and told in (254, 255)):  # SAM-MPDO, DAM-MPDO
            findings.error(
                count.line, f"[{count.section.name}]", f"{told} objects mapped", f"write 0 to {MAX_MAPPED}"
            )
        return
    bits = 0
    for sub in range(1, told + 1):
        slot = variables.get((mapping, sub))
        if slot is None:
            findings.error(
                count.line, label, f"maps {told} objects, [{mapping:04X}sub{sub}] is missing", "describe it"
            )
            return
        bits += _mapped_bits(kind, slot, variables, dummies, findings)
    if bits > MAX_PDO_BITS:
        findings.error(
            count.line, label, f"maps {bits} bits, a frame carries {MAX_PDO_BITS}", "map fewer objects"
        )
    elif granularity and bits % granularity:
        findings.error(
            count.line,
            label,
            f"maps {bits} bits, Granularity is {granularity}",
            "map whole units or correct Granularity",
        )
    enabled = cob_id is not None and not (cob_id.number() or 0) & NOT_VALID
    if enabled and not told:
        findings.warning(count.line, label, "is enabled and maps nothing", "map an object or set bit 31")


def _check_transmission(label: str, variable: Variable, kind: PdoKind, findings: Findings) -> None:
    value = variable.number()
    if value is None:
        return
    rtr_only = value in (252, 253)
    if 241 <= value <= 251 or (rtr_only and kind is RPDO):
        findings.error(
            variable.line, label, f"transmission type {value} is reserved", "use 0 to 240, 254 or 255"
        )
    elif rtr_only:
        findings.warning(
            variable.line, label, f"transmission type {value} needs remote frames", "use 0 to 240, 254 or 255"
        )


def _mapped_bits(
    kind: PdoKind, slot: Variable, variables: Variables, dummies: set[int], findings: Findings
) -> int:
    word = slot.number()
    where = f"[{slot.section.name}]"
    if word is None or word == 0:
        findings.error(
            slot.line, where, "counts as mapped and names no object", "map one or lower sub-index 0"
        )
        return 0
    index, sub, bits = word >> 16, word >> 8 & 0xFF, word & 0xFF
    name = f"{index:04X}h:{sub:02X}"
    if 1 <= index <= 7:
        if kind is TPDO or index not in dummies:
            findings.error(
                slot.line,
                where,
                f"maps dummy {name}",
                f"set Dummy{index:04d}=1 in [DummyUsage]" if kind is RPDO else "a TPDO cannot have one",
            )
        return bits
    target = variables.get((index, sub))
    if target is None:
        findings.error(slot.line, where, f"maps {name}, which is not in this file", "describe or replace it")
        return bits
    if not target.mappable:
        findings.error(
            slot.line,
            where,
            f"maps {name}, whose PDOMapping is 0",
            f"set PDOMapping=1 in [{target.section.name}]",
        )
    allowed = target.readable and target.access != "rww" if kind is TPDO else target.writable
    if target.access and kind is RPDO and target.access == "rwr":
        allowed = False
    if target.access and not allowed:
        findings.error(
            slot.line,
            where,
            f"maps {name}, whose access is {target.access}",
            f"a {kind.label} cannot carry it",
        )
    if target.info is not None and target.info.bits != bits:
        findings.error(
            slot.line,
            where,
            f"maps {bits} bits of {name}, a {target.info.name}",
            f"write 0x{(index << 16 | sub << 8 | target.info.bits):08X}"
            if target.info.bits
            else "map another",
        )
    return bits


def _cob_ids(variables: Variables) -> Iterator[tuple[str, Variable]]:
    """Everything that puts a COB-ID of its own on the bus."""
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


def _dummies_of(section: Section | None, findings: Findings) -> set[int]:
    """The data types that [DummyUsage] allows."""
    allowed = set()
    for number in range(1, 8) if section else ():
        assert section is not None
        text = section.value(f"Dummy{number:04d}")
        try:
            if text and parse_integer(text):
                allowed.add(number)
        except ValueError as error:
            line = section.line_of(f"Dummy{number:04d}")
            findings.error(line, f"[{section.name}] Dummy{number:04d}", str(error), "write 0 or 1")
    return allowed
