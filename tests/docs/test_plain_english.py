"""Docstrings, messages and help texts are plain technical English: no word that a reader has to decode."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = sorted(
    folder
    for package in ("edge/palpate_edge", "host/palpate_bus", "host/palpate_host", "host/palpate_twin")
    for folder in (ROOT / package).iterdir()
    if (folder / "__init__.py").exists()
)
FIRST_WORDS = re.compile(
    r"(Of|It|Its|That|What|Where|Who|Whose|Whether|How|They|Them|Those|These|This|There|One of|When)\b"
)
IDIOM = re.compile(
    r"\b((is|are|was|were|be|been) told|tells?|hears?|heard|wish(es|ed)?|goes away|"
    r"comes? back|came back|asks? of|believe[sd]?|the rim|for ever|says?|said|anew|reckons?|obeys?|names it|"
    r"leaves with|stands beside|is the matter|in the midst|makes? up|nothing is lost but|"
    r"whoever|whatever|by itself alone)\b",
    re.IGNORECASE,
)


def texts(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield line, kind (docstring or message) and text of all that a reader of the program may meet."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        if isinstance(node, documented) and (text := ast.get_docstring(node)):
            yield getattr(node, "lineno", 1), "docstring", text
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, "message", " ".join(strings(node.exc))
        elif isinstance(node, ast.Call):
            for keyword in node.keywords:
                if keyword.arg in ("help", "short_help", "epilog"):
                    yield node.lineno, "message", " ".join(strings(keyword.value))


def strings(node: ast.AST) -> Iterator[str]:
    for part in ast.walk(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield part.value


def faults(path: Path) -> list[str]:
    found = []
    for line, kind, text in texts(path):
        first = text.strip().splitlines()[0] if text.strip() else ""
        if kind == "docstring" and (match := FIRST_WORDS.match(first)):
            found.append(f"{path.relative_to(ROOT)}:{line}: begins with {match.group()!r}: {first}")
        if match := IDIOM.search(text):
            around = " ".join(text[max(0, match.start() - 40) : match.end() + 40].split())
            found.append(f"{path.relative_to(ROOT)}:{line}: {match.group()!r} in: {around}")
    return found


@pytest.mark.parametrize("room", ROOMS, ids=lambda room: f"{room.parent.name}.{room.name}")
def test_a_room_is_written_in_plain_english(room: Path) -> None:
    wrong = [fault for path in sorted(room.rglob("*.py")) for fault in faults(path)]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "text",
    ["Of the last tick.", "It was heard once.", "the dataset names it", "Leaves with 0 when it obeys."],
)
def test_the_old_idiom_is_found(tmp_path: Path, text: str) -> None:
    assert FIRST_WORDS.match(text) or IDIOM.search(text)
