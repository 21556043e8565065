"""Docstrings, messages and help texts are plain technical English: no word that a reader has to decode."""

from __future__ import annotations

import ast
import builtins
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.docs.plain_words import FIRST_WORDS, IDIOM, OLD_PHRASES
from tests.syntax_trees import nodes_of, parsed

ROOT = Path(__file__).resolve().parents[2]
ROOMS = sorted(
    folder
    for package in ("edge/palpate_edge", "host/palpate_bus", "host/palpate_host", "host/palpate_twin")
    for folder in (ROOT / package).iterdir()
    if (folder / "__init__.py").exists()
)


def texts(path: Path) -> Iterator[tuple[int, str, str]]:
    """Yield line, kind (docstring, message or help) and text of all that a reader of the program may meet."""
    tree = parsed(path)
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in nodes_of(tree):
        if isinstance(node, documented) and (text := ast.get_docstring(node)):
            yield getattr(node, "lineno", 1), "docstring", text
        elif isinstance(node, ast.Raise) and node.exc is not None:
            yield node.lineno, "message", " ".join(strings(node.exc))
        elif isinstance(node, ast.Call):
            for keyword in node.keywords:
                if keyword.arg in ("help", "short_help", "epilog"):
                    yield node.lineno, "help", " ".join(strings(keyword.value))


def strings(node: ast.AST) -> Iterator[str]:
    for part in ast.walk(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, str):
            yield part.value


def faults(path: Path) -> list[str]:
    found = []
    for line, kind, text in texts(path):
        first = text.strip().splitlines()[0] if text.strip() else ""
        if kind in {"docstring", "help"} and (match := FIRST_WORDS.match(first)):
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


def test_help_that_is_no_phrase_is_found(tmp_path: Path) -> None:
    path = tmp_path / "command.py"
    path.write_text('option("--fps", help="Of a camera.")')
    assert [kind for _, kind, text in texts(path) if FIRST_WORDS.match(text)] == ["help"]


def sentences(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and text of each string of words: messages wherever they are made, logs, tables and plots.

    An f-string is one text, with X for its values. Docstrings are left out.
    """
    left_out = {id(node.value) for node in nodes_of(tree) if isinstance(node, ast.Expr)}
    for node in nodes_of(tree):
        if isinstance(node, ast.JoinedStr):
            left_out.update(map(id, node.values))
            yield node.lineno, literal_text(node)
    for node in nodes_of(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in left_out:
            yield node.lineno, node.value


def literal_text(node: ast.JoinedStr) -> str:
    return "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in node.values)


def modules() -> Iterator[tuple[Path, ast.Module]]:
    for room in ROOMS:
        for path in sorted(room.rglob("*.py")):
            yield path, parsed(path)


PRINTED_BY_CONTRACT = {"X frames, X markers: X came back, X swapped"}
"""The summary of ``palpate-edge follow``, which scripts read."""


def test_no_text_of_a_program_has_the_old_idiom() -> None:
    """This reaches every refusal, also one whose text is made in another function or read from a table."""
    found = [(path, line, text) for path, tree in modules() for line, text in sentences(tree) if " " in text]
    assert len(found) > 1500  # the scan sees the texts
    assert not [
        f"{path.relative_to(ROOT)}:{line}: {text}"
        for path, line, text in found
        if IDIOM.search(text) and text not in PRINTED_BY_CONTRACT
    ]


def test_a_message_in_a_variable_is_found() -> None:
    tree = ast.parse(
        '"""Says."""\ntext = f"no {name} on {path}: " f"the dataset names it"\nraise error(text)'
    )
    assert [line for line, text in sentences(tree) if IDIOM.search(text)] == [2]


def refusals() -> Iterator[tuple[Path, int, str]]:
    """Yield file, line and literal text of every error of ours that is raised."""
    for path, tree in modules():
        for node in nodes_of(tree):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                name = ast.unparse(node.exc.func)
                if name.endswith("Error") and name not in BUILT_IN and (text := " ".join(strings(node.exc))):
                    yield path, node.lineno, text


BUILT_IN = {name for name in dir(builtins) if name.endswith("Error")}


def test_no_error_has_a_phrase_of_the_old_messages() -> None:
    found = [f"{path.relative_to(ROOT)}:{line}: {text}" for path, line, text in refusals()]
    assert len(found) > 200  # the scan sees the errors
    assert not [text for text in found if OLD_PHRASES.search(text.split(": ", 1)[1])]


def test_no_error_passes_on_the_words_of_another_library() -> None:
    """An exception of msgspec inside an f-string would bring its text to the user."""
    wrong = []
    for path, tree in modules():
        for node in nodes_of(tree):
            if not isinstance(node, ast.ExceptHandler) or node.name is None or node.type is None:
                continue
            if "msgspec" in ast.unparse(node.type):
                used = {part.id for part in ast.walk(ast.Module(node.body, [])) if isinstance(part, ast.Name)}
                if node.name in used:
                    wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}")
    assert not wrong, wrong


REASON = re.compile(r"\.strerror\b|^reason_of\(")
WAY_OUT_AHEAD = re.compile(r"[:;] .*\(")
"""A remedy, with the reason in parentheses after it."""
SHORT_ROOMS = {"datasets"}
"""For an input file, its name and the reason are enough: ``frame.png: no such file``."""


def ends_in_a_reason(node: ast.JoinedStr) -> bool:
    """Return whether the operating system's text ends a message, and no remedy precedes or follows it."""
    parts = node.values
    reasons = [
        number
        for number, part in enumerate(parts)
        if isinstance(part, ast.FormattedValue) and REASON.search(ast.unparse(part.value))
    ]
    if not reasons:
        return False
    before, after = (
        literal_text(ast.JoinedStr(some)) for some in (parts[: reasons[0]], parts[reasons[-1] + 1 :])
    )
    return len(re.findall(r"[A-Za-z]+", after)) < 1 and not WAY_OUT_AHEAD.search(before)


def messages(tree: ast.Module) -> Iterator[ast.JoinedStr]:
    """Yield the f-strings that are passed to an error, a log or the end of a program."""
    for node in nodes_of(tree):
        if isinstance(node, ast.Call) and re.search(
            r"(?i)(error|exit_with|warning)$", ast.unparse(node.func)
        ):
            yield from (value for value in node.args if isinstance(value, ast.JoinedStr))


def test_no_message_ends_in_the_reason_of_the_operating_system() -> None:
    found = [(path, node) for path, tree in modules() for node in messages(tree)]
    assert len(found) > 200  # the scan sees the messages
    wrong = [
        f"{path.relative_to(ROOT)}:{node.lineno}: {literal_text(node)}"
        for path, node in found
        if ends_in_a_reason(node) and path.parent.name not in SHORT_ROOMS
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    ("message", "is_bare"),
    [
        ('f"{path}: {reason_of(error)}"', True),
        ('f"{path} cannot be read ({error.strerror or error})."', True),
        ('f"{path}: {reason_of(error)}; give another path"', False),
        ('f"{path}: {reason_of(error)}; {remedy}"', False),
        ('f"no hand is running; start one: palpate-host run ({error.strerror})"', False),
        ('f"{path}: no such file"', False),
    ],
)
def test_a_bare_reason_is_found(message: str, is_bare: bool) -> None:
    tree = ast.parse(message, mode="eval")
    assert isinstance(tree.body, ast.JoinedStr)
    assert ends_in_a_reason(tree.body) is is_bare
