"""The documentation against the code: links, the bus contract, configuration keys, quoted messages."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.node.eds import load_eds
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec
from palpate_host.config.hand_config import HandConfig

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")),
    *sorted((ROOT / "docs").glob("*.md")),
]
SOURCES = "\n".join(path.read_text() for part in ("edge", "host") for path in (ROOT / part).rglob("*.py"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_relative_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text()):
        assert (page.parent / target).exists(), target


@pytest.mark.parametrize("number", [1, 2, 3, 4, 5])
def test_tpdos_of_the_page_are_those_of_the_eds(number):
    row = re.search(rf"^\| {number} \| (0x\w+) \+ id \|[^|]*\| ([^|]*) \|", bus_page(), re.MULTILINE)
    assert row is not None
    codec = pdo_codec(load_eds(FINGERTIP_EDS, 0x10), PdoDirection.TRANSMIT, number)
    assert codec.cob_id == int(row[1], 16) + 0x10
    named = []
    for first, subs, last in re.findall(r"(\w{4})h(?::([\d-]+))?(?:-(\w{4})h)?", row[2]):
        if subs:
            low, _, high = subs.partition("-")
            named += [(int(first, 16), sub) for sub in range(int(low), int(high or low) + 1)]
        else:
            named += [(index, 0) for index in range(int(first, 16), int(last or first, 16) + 1)]
    assert set(codec.decode(bytes(codec.length_bytes))) == set(named)


def bus_page() -> str:
    return (ROOT / "docs" / "bus.md").read_text()


def keys_of(struct: type[msgspec.Struct], prefix: str = "") -> set[str]:
    """Dotted keys of a configuration, lists as ``name[]``."""
    found = set()
    for field in msgspec.structs.fields(struct):
        kind, name = field.type, prefix + field.name
        inner = msgspec.inspect.type_info(kind)
        if isinstance(inner, msgspec.inspect.StructType):
            found |= keys_of(inner.cls, f"{name}.")
        elif isinstance(inner, msgspec.inspect.VarTupleType) and isinstance(
            inner.item_type, msgspec.inspect.StructType
        ):
            found |= keys_of(inner.item_type.cls, f"{name}[].")
        else:
            found.add(name)
    return found


def documented_keys(title: str) -> set[str]:
    """First cells of the table under a heading; ``a.b, c`` means a.b and a.c."""
    section = (ROOT / "docs" / "configuration.md").read_text().split(f"## {title}")[1].split("\n## ")[0]
    found = set()
    for cell in re.findall(r"^\| ([a-z][\w.\[\], *]*) \|", section, re.MULTILINE):
        first, *others = cell.split(", ")
        stem = first.rpartition(".")[0]
        found |= {first, *(f"{stem}.{other}" if stem else other for other in others)}
    return found - {"key"}


def test_fingertip_keys_are_documented_and_exist():
    assert documented_keys("A fingertip") == keys_of(FingertipConfig)


def test_hand_keys_are_documented_and_exist():
    documented = {key for key in documented_keys("A hand") if not key.startswith("bus.")}
    assert documented == {key for key in keys_of(HandConfig) if not key.startswith("bus.")}


@pytest.mark.parametrize("page", ["troubleshooting.md", "calibrating.md"])
def test_quoted_messages_stand_in_the_sources(page):
    text = (ROOT / "docs" / page).read_text()
    code = re.sub(r'"\s*\n\s*f?"', "", SOURCES)
    for message in re.findall(r"^\| `([^`]+)` \|", text, re.MULTILINE):
        words = [part.strip() for part in re.split(r"\.\.\.|\bWxH\b|\bN\b|\bM\b|0x\.\.", message)]
        for part in filter(None, words):
            assert part in code, part


def test_messages_of_the_deploying_page_stand_in_what_is_deployed():
    files = [path for path in (ROOT / "ansible").rglob("*") if path.suffix in {".py", ".sh", ".yml"}]
    code = " ".join(" ".join(path.read_text() for path in files).split())
    table = (ROOT / "docs" / "deploying.md").read_text().split("## Troubleshooting")[1]
    messages = re.findall(r"^\| `([^`]+)` \|", table, re.MULTILINE)
    assert len(messages) > 5
    for message in messages:
        for part in filter(None, (part.strip(": ") for part in re.split(r"\.\.\.|is activating", message))):
            assert part in code, part


NAMED_TESTS = re.findall(r"`(test_\w+)::(test_\w+)`", (ROOT / "docs" / "canopen.md").read_text())


def test_every_row_of_the_canopen_page_names_a_test_or_says_no():
    for row in re.findall(r"^\| .*\|$", (ROOT / "docs" / "canopen.md").read_text(), re.MULTILINE):
        heads = row.startswith("| service |") or row.endswith("| test |")
        assert heads or "::test_" in row or "| no |" in row, row
    assert len(NAMED_TESTS) > 50


@pytest.mark.parametrize(("file", "name"), sorted(set(NAMED_TESTS)))
def test_tests_of_the_canopen_page_exist(file, name):
    (path,) = (ROOT / "tests").rglob(f"{file}.py")
    assert re.search(rf"^def {name}\(", path.read_text(), re.MULTILINE)


def test_objects_of_the_canopen_page_are_in_the_eds():
    """Of the tables, abort codes aside; the objects of node guarding are named because they are absent."""
    rows = re.findall(r"^\|.*\|$", (ROOT / "docs" / "canopen.md").read_text(), re.MULTILINE)
    named = {index for row in rows for index in re.findall(r"(?<![0-9A-F] )\b([1-7][0-9A-F]{3})h\b", row)}
    missing = {index for index in named if int(index, 16) not in load_eds(FINGERTIP_EDS, 0x10).indices}
    assert missing == {"100C", "100D", "1FFF"}
