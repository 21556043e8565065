"""Check of an EDS file against CiA 306-1 (format) and CiA 301 (communication objects).

`check_text` never raises: any file of any vendor gives findings. It checks, in this order: lines and
sections; [FileInfo] and [DeviceInfo]; the three lists of objects against the sections; every object's keys,
data type, access, default and limits; CiA 301's own objects; PDO mappings; COB-IDs.
"""

from __future__ import annotations

import re
from pathlib import Path

from palpate_bus.eds.communication import check_communication
from palpate_bus.eds.objects import OBJECT_SECTION, SUB_SECTION, read_objects
from palpate_bus.eds.pdo import PDO_KINDS, pdo_numbers
from palpate_bus.eds.text import Finding, Findings, Section, parse_sections, read_text
from palpate_bus.eds.values import parse_integer
from palpate_bus.eds.variable import Variables

BAUD_RATES_KBIT_S = (10, 20, 50, 125, 250, 500, 800, 1000)
MANDATORY_OBJECTS = (0x1000, 0x1001, 0x1018)
LISTS = {
    "MandatoryObjects": (MANDATORY_OBJECTS,),
    "OptionalObjects": (range(0x1000, 0x2000), range(0x6000, 0x10000)),
    "ManufacturerObjects": (range(0x2000, 0x6000),),
}
_DATE = re.compile(r"(0[1-9]|1[0-2])-(0[1-9]|[12]\d|3[01])-\d{4}")
_TIME = re.compile(r"(0?[1-9]|1[0-2]):[0-5]\d\s*(AM|PM)")
_FLAGS = (
    *(f"BaudRate_{rate}" for rate in BAUD_RATES_KBIT_S),
    "SimpleBootUpMaster",
    "SimpleBootUpSlave",
    "DynamicChannelsSupported",
    "GroupMessaging",
    "LSS_Supported",
)
_REQUIRED = ("VendorName", "VendorNumber", "ProductName", "ProductNumber", "NrOfRXPDO", "NrOfTXPDO")
_IDENTITY = {1: "VendorNumber", 2: "ProductNumber", 3: "RevisionNumber"}


def check_file(path: Path) -> list[Finding]:
    """Return the findings in the order of lines. Raises ConfigError when the file cannot be read."""
    return check_text(read_text(path), path.name)


def check_text(text: str, file_name: str) -> list[Finding]:
    """Return the findings in the order of lines; those without a line come first."""
    findings = Findings()
    sections = parse_sections(text, findings)
    for name in ("FileInfo", "DeviceInfo", "MandatoryObjects"):
        if name.lower() not in sections:
            findings.error(0, f"[{name}]", "is missing", "add the section (CiA 306-1)")
    _check_file_info(sections.get("fileinfo"), file_name, findings)
    variables = read_objects(sections, findings)
    _check_lists(sections, findings)
    device = sections.get("deviceinfo")
    granularity = _check_device(device, variables, findings) if device else 0
    check_communication(sections, variables, granularity, findings)
    return sorted(findings.found, key=lambda finding: finding.line)


def _check_file_info(section: Section | None, file_name: str, findings: Findings) -> None:
    if section is None:
        return
    where = f"[{section.name}]"
    for key in ("FileName", "FileVersion", "FileRevision", "EDSVersion"):
        if not section.value(key):
            findings.error(section.line_of(key), where, f"{key} is missing or empty", f"write {key}=...")
    for key in ("FileVersion", "FileRevision"):
        _number(section, key, 0xFF, findings)
    named = section.value("FileName")
    if named and named != file_name:
        findings.warning(
            section.line_of("FileName"), f"{where} FileName", f"is {named!r}", f"write FileName={file_name}"
        )
    version = section.value("EDSVersion")
    if version and not re.fullmatch(r"\d\.\d", version):
        findings.error(section.line_of("EDSVersion"), f"{where} EDSVersion", f"is {version!r}", "write 4.0")
    for key, form, example in (
        ("CreationDate", _DATE, "mm-dd-yyyy"),
        ("ModificationDate", _DATE, "mm-dd-yyyy"),
        ("CreationTime", _TIME, "hh:mmAM or hh:mmPM"),
        ("ModificationTime", _TIME, "hh:mmAM or hh:mmPM"),
    ):
        value = section.value(key)
        if value and not form.fullmatch(value):
            findings.error(section.line_of(key), f"{where} {key}", f"is {value!r}", f"write {example}")


def _check_device(section: Section, variables: Variables, findings: Findings) -> int:
    """Check [DeviceInfo] against the objects; return the granularity of PDO mapping."""
    where = f"[{section.name}]"
    for key in _REQUIRED:
        if section.item(key) is None:
            findings.warning(section.line, where, f"has no {key}", f"write {key}=...")
    for key in _FLAGS:
        _number(section, key, 1, findings)
    if not any(section.value(f"BaudRate_{rate}") not in ("", "0") for rate in BAUD_RATES_KBIT_S):
        findings.error(section.line, where, "supports no bit rate", "set one BaudRate_... to 1")
    for kind in PDO_KINDS:
        declared, found = _number(section, kind.count_key, 512, findings), len(pdo_numbers(variables, kind))
        if declared is not None and declared != found:
            findings.error(
                section.line_of(kind.count_key),
                f"{where} {kind.count_key}",
                f"is {declared}, but {found} are described",
                f"write {kind.count_key}={found}",
            )
    for sub, key in _IDENTITY.items():
        declared, identity = _number(section, key, 0xFFFFFFFF, findings), variables.get((0x1018, sub))
        default = identity.number() if identity else None
        if declared is not None and default is not None and declared != default:
            findings.warning(
                section.line_of(key),
                f"{where} {key}",
                f"is {declared}, but 1018h:{sub:02X} is {default}",
                "make them equal",
            )
    lss = _number(section, "LSS_Supported", 1, findings)
    missing = [sub for sub in range(1, 5) if (0x1018, sub) not in variables]
    if lss and missing:
        findings.error(
            section.line_of("LSS_Supported"),
            f"{where} LSS_Supported",
            f"is 1, but 1018h lacks sub-index {missing[0]} of the LSS address",
            "describe 1018h:01 to 04",
        )
    return _number(section, "Granularity", 64, findings) or 0


def _check_lists(sections: dict[str, Section], findings: Findings) -> None:
    listed: dict[int, str] = {}
    for name, ranges in LISTS.items():
        section = sections.get(name.lower())
        if section is not None:
            for index, line in _listed(section, findings):
                where = f"[{name}]"
                if index in listed:
                    findings.error(
                        line, where, f"{index:04X}h is also listed in [{listed[index]}]", "remove one"
                    )
                listed.setdefault(index, name)
                if not any(index in allowed for allowed in ranges):
                    findings.error(
                        line, where, f"{index:04X}h is outside this list's range", "move it to its list"
                    )
                if f"{index:04x}" not in sections:
                    findings.error(line, where, f"{index:04X}h has no section", f"add [{index:04X}]")
    for index in MANDATORY_OBJECTS:
        if f"{index:04x}" not in sections:
            findings.error(0, f"[{index:04X}]", "is mandatory and missing", "describe it (CiA 301)")
        elif listed.get(index) != "MandatoryObjects" and "mandatoryobjects" in sections:
            line = sections["mandatoryobjects"].line
            findings.error(line, "[MandatoryObjects]", f"{index:04X}h is not listed", f"add 0x{index:04X}")
    for name, section in sections.items():
        if OBJECT_SECTION.fullmatch(name) and int(name, 16) not in listed and int(name, 16) >= 0x1000:
            findings.error(
                section.line,
                f"[{section.name}]",
                "is not in a list of objects",
                "add it to one and increase SupportedObjects",
            )
        elif not OBJECT_SECTION.fullmatch(name) and not _known(name):
            findings.warning(
                section.line, f"[{section.name}]", "is not a section of CiA 306", "check its name"
            )


def _listed(section: Section, findings: Findings) -> list[tuple[int, int]]:
    """Return (index, line) of the entries 1, 2, ...; report a wrong count or numbering."""
    entries = {key: item for key, item in section.items.items() if key != "supportedobjects"}
    count = _number(section, "SupportedObjects", 0xFFFF, findings)
    line = section.line_of("SupportedObjects")
    if count is None:
        findings.error(line, f"[{section.name}]", "has no SupportedObjects", f"write {len(entries)}")
    elif count != len(entries):
        findings.error(
            line,
            f"[{section.name}]",
            f"SupportedObjects is {count}, but {len(entries)} are listed",
            f"write SupportedObjects={len(entries)}",
        )
    found = []
    for place, item in enumerate(entries.values(), start=1):
        if item.key != str(place):
            findings.error(
                item.line,
                f"[{section.name}]",
                f"entry {item.key!r} instead of '{place}'",
                "number the entries from 1 on",
            )
        try:
            index = parse_integer(item.value)
        except ValueError as error:
            findings.error(item.line, f"[{section.name}] {item.key}", str(error), "write 0x and four digits")
            continue
        found.append((index, item.line))
    return found


def _known(name: str) -> bool:
    plain = (
        "fileinfo",
        "deviceinfo",
        "dummyusage",
        "comments",
        "standarddatatypes",
        "dynamicchannels",
        "tools",
    )
    others = (r"[0-9a-f]{4}(name|value|denotation|objectlinks)", r"m\d+.*", r"tool\d+", r"supportedmodules")
    return (
        name in plain
        or name in {key.lower() for key in LISTS}
        or SUB_SECTION.fullmatch(name) is not None
        or any(re.fullmatch(other, name) for other in others)
        or name in ("devicecomissioning", "devicecommissioning", "connectedmodules")
    )


def _number(section: Section, key: str, highest: int, findings: Findings) -> int | None:
    """Return an optional number from 0 to `highest`, None when it is missing, empty or wrong."""
    text = section.value(key)
    if not text:
        return None
    try:
        value = parse_integer(text)
    except ValueError as error:
        findings.error(section.line_of(key), f"[{section.name}] {key}", str(error), "write a number")
        return None
    if not 0 <= value <= highest:
        findings.error(
            section.line_of(key), f"[{section.name}] {key}", f"is {value}", f"write 0 to {highest}"
        )
        return None
    return value
