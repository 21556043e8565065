"""Text of an EDS file, line by line: sections, entries and invalid lines (CiA 306-1, 4.2 and 4.3).

No content of a file raises an exception: any vendor's file is read, with findings. Names of sections and keys
are case-insensitive, as in every tool that reads such files.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from palpate_edge.common.errors import ConfigError

MAX_LINE = 255  # CiA 306-1: characters of a line
MAX_FILE_BYTES = 16 * 1024 * 1024

_SECTION = re.compile(r"\[(?P<name>[^\]]*)\]\s*(?:;.*)?")
_ENTRY = re.compile(r"(?P<key>[^=]*)=(?P<value>.*)")
_INLINE_COMMENT = re.compile(r"(?:^|\s);.*")


class Severity(Enum):
    """Severity of a finding.

    ERROR: the file violates CiA 306 or CiA 301. WARNING: allowed, but probably a mistake.
    """

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """One problem in a file.

    line: from 1 on; 0 for something missing. where: section and key. way_out: how to correct it.
    """

    line: int
    severity: Severity
    where: str
    problem: str
    way_out: str

    def text(self, name: str) -> str:
        """Return the finding as one line, in the form file:line that editors recognise."""
        place = f"{name}:{self.line}" if self.line else name
        message = f"{place}: {self.severity.value}: {self.where}: {self.problem}: {self.way_out}"
        return "".join(character if character.isprintable() else "?" for character in message)


@dataclass(slots=True)
class Findings:
    """Collection of findings."""

    found: list[Finding] = field(default_factory=list)

    def error(self, line: int, where: str, problem: str, way_out: str) -> None:
        self.found.append(Finding(line, Severity.ERROR, where, problem, way_out))

    def warning(self, line: int, where: str, problem: str, way_out: str) -> None:
        self.found.append(Finding(line, Severity.WARNING, where, problem, way_out))


@dataclass(frozen=True, slots=True)
class Item:
    """One entry ``key=value`` and its line."""

    key: str
    value: str
    line: int


@dataclass(frozen=True, slots=True)
class Section:
    """One section ``[name]`` and its entries by lower-case key."""

    name: str
    line: int
    items: dict[str, Item] = field(default_factory=dict)

    def item(self, key: str) -> Item | None:
        return self.items.get(key.lower())

    def value(self, key: str) -> str:
        """Return the entry's value, empty when it is missing."""
        item = self.item(key)
        return item.value if item else ""

    def line_of(self, key: str) -> int:
        """Return the entry's line, or the section's when the entry is missing."""
        item = self.item(key)
        return item.line if item else self.line


def read_text(path: Path) -> str:
    """Return the file's text, decoded as Latin-1, which accepts every byte.

    Raises ConfigError when the file cannot be read, is larger than MAX_FILE_BYTES or contains a zero byte.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigError(f"EDS {path}: larger than {MAX_FILE_BYTES >> 20} MiB: give an EDS file")
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"EDS {path}: cannot be read ({error.strerror}): check the path") from error
    if b"\0" in data:
        raise ConfigError(
            f"EDS {path}: byte {data.index(0)} is zero, so this is not a text file: give an EDS file"
        )
    return data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def parse_sections(text: str, findings: Findings) -> dict[str, Section]:
    """Return the sections by lower-case name, in the file's order; of duplicates the first is used."""
    sections: dict[str, Section] = {}
    current: Section | None = None
    for number, raw in enumerate(re.split(r"\r\n|\r|\n", text), start=1):
        line = raw.strip()
        if len(raw) > MAX_LINE:
            findings.warning(
                number, "line", f"{len(raw)} characters", f"CiA 306 allows {MAX_LINE}: shorten it"
            )
        if not line or line.startswith(";"):
            continue
        if line.startswith("["):
            current = _section(line, number, sections, findings)
        elif current is None:
            findings.error(number, "line", f"{_short(line)} precedes the first section", "remove it")
        else:
            _entry(line, number, current, findings)
    return sections


def _section(line: str, number: int, sections: dict[str, Section], findings: Findings) -> Section:
    match = _SECTION.fullmatch(line)
    name = match["name"].strip() if match else line.strip("[]").strip()
    if match is None:
        findings.error(
            number, "line", f"{_short(line)} is not a [section] line", "write only the name in brackets"
        )
    section = Section(name, number)
    first = sections.setdefault(name.lower(), section)
    if first is not section:
        findings.error(number, f"[{name}]", f"is already defined in line {first.line}", "remove one of them")
    return section


def _entry(line: str, number: int, section: Section, findings: Findings) -> None:
    match = _ENTRY.fullmatch(line)
    if match is None:
        findings.error(
            number,
            f"[{section.name}]",
            f"{_short(line)} is not key=value",
            "correct the line or comment it out",
        )
        return
    key = match["key"].strip()
    value = _INLINE_COMMENT.sub("", match["value"]).strip()
    item = Item(key, value, number)
    first = section.items.setdefault(key.lower(), item)
    if first is not item:
        findings.error(
            number,
            f"[{section.name}] {key}",
            f"is already defined in line {first.line}",
            "remove one of them",
        )


def _short(line: str) -> str:
    return repr(line if len(line) <= 40 else line[:37] + "...")
