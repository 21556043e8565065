"""Checks of an EDS file's PDOs against CiA 301: complete parameters, valid mappings, 64 bits at most.

A PDO that the file disables may map up to 512 bits: it may be one for CAN FD, of which CiA 301 has nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate_bus.eds.text import Findings, Section
from palpate_bus.eds.values import parse_integer
from palpate_bus.eds.variable import Variable, Variables

NOT_VALID = 1 << 31
MAX_PDO_BITS, MAX_FD_PDO_BITS = 64, 512
MAX_MAPPED = 64


@dataclass(frozen=True, slots=True)
class PdoKind:
    """Kind of PDO: label, first indices of its parameters, and its count's key in [DeviceInfo]."""

    label: str
    communication: int
    mapping: int
    count_key: str


TPDO = PdoKind("TPDO", 0x1800, 0x1A00, "NrOfTXPDO")
RPDO = PdoKind("RPDO", 0x1400, 0x1600, "NrOfRXPDO")
PDO_KINDS = (TPDO, RPDO)
PDOS = 512


def pdo_numbers(variables: Variables, kind: PdoKind) -> list[int]:
    """Return the numbers, from 1 on, of the PDOs that have communication or mapping parameters."""
    numbers = {index - base + 1 for index, _ in variables for base in (kind.communication, kind.mapping)}
    return sorted(number for number in numbers if 1 <= number <= PDOS)


def check_pdo(
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
    mapped = count.number() or 0
    if not 0 <= mapped <= MAX_MAPPED:
        if not (kind is RPDO and mapped in (254, 255)):  # SAM-MPDO, DAM-MPDO
            findings.error(
                count.line, f"[{count.section.name}]", f"maps {mapped} objects", f"write 0 to {MAX_MAPPED}"
            )
        return
    bits = 0
    for sub in range(1, mapped + 1):
        slot = variables.get((mapping, sub))
        if slot is None:
            findings.error(
                count.line,
                label,
                f"maps {mapped} objects, but [{mapping:04X}sub{sub}] is missing",
                "describe it",
            )
            return
        bits += _mapped_bits(kind, slot, variables, dummies, findings)
    enabled = cob_id is not None and not (cob_id.number() or 0) & NOT_VALID
    most_bits = MAX_PDO_BITS if enabled else MAX_FD_PDO_BITS
    if bits > most_bits:
        findings.error(
            count.line,
            label,
            f"maps {bits} bits, a frame has {most_bits}",
            "map fewer objects",
        )
    elif granularity and bits % granularity:
        findings.error(
            count.line,
            label,
            f"maps {bits} bits, not a multiple of Granularity {granularity}",
            "map a multiple of it, or correct Granularity",
        )
    if enabled and not mapped:
        findings.warning(
            count.line, label, "is enabled but maps no object", "map one, or set bit 31 of its COB-ID"
        )


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
            variable.line,
            label,
            f"transmission type {value} requires remote frames",
            "use 0 to 240, 254 or 255",
        )


def _mapped_bits(
    kind: PdoKind, slot: Variable, variables: Variables, dummies: set[int], findings: Findings
) -> int:
    word = slot.number()
    where = f"[{slot.section.name}]"
    if word is None or word == 0:
        findings.error(
            slot.line, where, "is counted as mapped but contains no object", "map one, or lower sub-index 0"
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
                f"set Dummy{index:04d}=1 in [DummyUsage]" if kind is RPDO else "a TPDO cannot map a dummy",
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
            f"map an object that a {kind.label} may contain",
        )
    if target.info is not None and target.info.bits != bits:
        findings.error(
            slot.line,
            where,
            f"maps {bits} bits of {name}, whose type is {target.info.name}",
            f"write 0x{(index << 16 | sub << 8 | target.info.bits):08X}"
            if target.info.bits
            else "map another object",
        )
    return bits


def dummies_of(section: Section | None, findings: Findings) -> set[int]:
    """Return the data types that [DummyUsage] allows."""
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
