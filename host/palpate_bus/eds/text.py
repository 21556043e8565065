"""The text of an EDS file, line by line: sections, entries, and what is neither (CiA 306-1, 4.2 and 4.3).

Nothing here raises for what stands in the file: any vendor's file comes through, with findings. Names of
sections and keys are compared without regard to case, as every tool that reads such files does.
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
    """ERROR: the file breaks CiA 306 or CiA 301. WARNING: allowed, and likely a mistake."""

    ERROR = "error"
    WARNING = "warning"


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong. line: 1-based; 0 when it stands nowhere. where: section and key."""

    line: int
    severity: Severity
    where: str
    problem: str
    way_out: str

    def text(self, name: str) -> str:
        """One line for a person and for an editor's "go to line"."""
        place = f"{name}:{self.line}" if self.line else name
        said = f"{place}: {self.severity.value}: {self.where}: {self.problem}: {self.way_out}"
        return "".join(character if character.isprintable() else "?" for character in said)


@dataclass(slots=True)
class Findings:
    """Collects findings."""

    found: list[Finding] = field(default_factory=list)

    def error(self, line: int, where: str, problem: str, way_out: str) -> None:
        self.found.append(Finding(line, Severity.ERROR, where, problem, way_out))

    def warning(self, line: int, where: str, problem: str, way_out: str) -> None:
        self.found.append(Finding(line, Severity.WARNING, where, problem, way_out))


@dataclass(frozen=True, slots=True)
class Item:
    """``key=value`` and where it stands."""

    key: str
    value: str
    line: int


@dataclass(frozen=True, slots=True)
class Section:
    """``[name]`` and its entries by lower-case key."""

    name: str
    line: int
    items: dict[str, Item] = field(default_factory=dict)

    def item(self, key: str) -> Item | None:
        return self.items.get(key.lower())

    def value(self, key: str) -> str:
        """The entry's text, empty when it is missing."""
        item = self.item(key)
        return item.value if item else ""

    def line_of(self, key: str) -> int:
        """The entry's line, else the section's."""
        item = self.item(key)
        return item.line if item else self.line


def read_text(path: Path) -> str:
    """The file's characters; ConfigError when it cannot be read or is no text. Latin-1 takes every byte."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ConfigError(f"EDS {path}: larger than {MAX_FILE_BYTES >> 20} MiB: give an EDS file")
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"EDS {path}: cannot be read ({error.strerror}): check the path") from error
    if b"\0" in data:
        raise ConfigError(f"EDS {path}: byte {data.index(0)} is zero, so it is no text: give an EDS file")
    return data.removeprefix(b"\xef\xbb\xbf").decode("latin-1")


def parse_sections(text: str, findings: Findings) -> dict[str, Section]:
    """Sections by lower-case name, in the file's order; of what stands twice the first counts."""
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
            findings.error(number, "line", f"{_short(line)} stands before any section", "remove it")
        else:
            _entry(line, number, current, findings)
    return sections


def _section(line: str, number: int, sections: dict[str, Section], findings: Findings) -> Section:
    match = _SECTION.fullmatch(line)
    name = match["name"].strip() if match else line.strip("[]").strip()
    if match is None:
        findings.error(number, "line", f"{_short(line)} is no [section]", "write the name in brackets alone")
    section = Section(name, number)
    first = sections.setdefault(name.lower(), section)
    if first is not section:
        findings.error(number, f"[{name}]", f"stands in line {first.line} already", "remove one of them")
    return section


def _entry(line: str, number: int, section: Section, findings: Findings) -> None:
    match = _ENTRY.fullmatch(line)
    if match is None:
        findings.error(
            number,
            f"[{section.name}]",
            f"{_short(line)} is no key=value",
            "correct the line or comment it out",
        )
        return
    key = match["key"].strip()
    value = _INLINE_COMMENT.sub("", match["value"]).strip()
    item = Item(key, value, number)
    first = section.items.setdefault(key.lower(), item)
    if first is not item:
        findings.error(
            number, f"[{section.name}] {key}", f"stands in line {first.line} already", "remove one of them"
        )


def _short(line: str) -> str:
    return repr(line if len(line) <= 40 else line[:37] + "...")
