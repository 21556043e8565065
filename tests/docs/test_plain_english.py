"""Docstrings, messages and help texts are plain technical English: no word that a reader has to decode."""

from __future__ import annotations

import ast
import builtins
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


def refusals() -> Iterator[tuple[Path, int, str]]:
    """Yield file, line and literal text of every error of ours that is raised."""
    for room in ROOMS:
        for path in sorted(room.rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                    name = ast.unparse(node.exc.func)
                    if (
                        name.endswith("Error")
                        and name not in BUILT_IN
                        and (text := " ".join(strings(node.exc)))
                    ):
                        yield path, node.lineno, text


BUILT_IN = {name for name in dir(builtins) if name.endswith("Error")}
OLD_PHRASES = re.compile(
    r"the dataset names it|is no (image|video|whole|capture|ring)\b|numbers that are none|"
    r"cannot be made anew|^no host on|Object contains|Invalid enum|\bErrno\b"
)


def test_no_error_has_a_phrase_of_the_old_messages() -> None:
    found = [f"{path.relative_to(ROOT)}:{line}: {text}" for path, line, text in refusals()]
    assert len(found) > 200  # the scan sees the errors
    assert not [text for text in found if OLD_PHRASES.search(text.split(": ", 1)[1])]


def test_no_error_passes_on_the_words_of_another_library() -> None:
    """An exception of msgspec inside an f-string would bring its text to the user."""
    wrong = []
    for room in ROOMS:
        for path in sorted(room.rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if not isinstance(node, ast.ExceptHandler) or node.name is None or node.type is None:
                    continue
                if "msgspec" in ast.unparse(node.type):
                    used = {
                        part.id for part in ast.walk(ast.Module(node.body, [])) if isinstance(part, ast.Name)
                    }
                    if node.name in used:
                        wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert not wrong, wrong
