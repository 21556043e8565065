"""Pages, playbooks, units, the Makefile and the firmware's comments are plain technical English."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.docs.plain_words import FIRST_WORDS, IDIOM

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    [
        *(ROOT / "docs").glob("*.md"),
        *(ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "demo/README.md")),
        *(ROOT / "firmware").rglob("*.md"),
    ]
)
TEXTS = sorted(
    path
    for folder in ("ansible", "systemd", "firmware/board")
    for path in (ROOT / folder).rglob("*")
    if path.is_file() and path.suffix not in {".md", ".py", ".pyc"}
)
HASH_COMMENTED = sorted(
    [
        *(
            ROOT / "Makefile",
            ROOT / "firmware/illumination/Makefile",
            ROOT / "pyproject.toml",
            ROOT / ".ci/run",
        ),
        *(ROOT / "host/palpate_host/models").glob("*.toml"),
        *(ROOT / "firmware/illumination").glob("*.toml"),
        *(ROOT / "requirements").glob("*.in"),
        *(ROOT / "requirements").glob("*.sh"),
    ]
)
C_COMMENTED = sorted((ROOT / "firmware").rglob("*.[ch]"))
SCRIPTS = sorted(
    [
        *(ROOT / "ansible").rglob("*.py"),
        *(ROOT / "firmware").rglob("*.py"),
        *(ROOT / "tests/kernel").rglob("*.py"),
    ]
)
NEWLINE = "\n"
NOT_USED = re.compile(r"\|[^|]*\|$", re.MULTILINE)
"""Last column of the glossary: words that are not used."""


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def prose_of_page(path: Path) -> str:
    """Return a page without code, whose words are not ours to choose; lines keep their numbers."""
    text = path.read_text(encoding="utf-8")
    if path.name == "glossary.md":
        text = NOT_USED.sub("|", text)
    text = re.sub(
        r"^```.*?^```", lambda code: "\n" * code[0].count("\n"), text, flags=re.MULTILINE | re.DOTALL
    )
    return re.sub(r"`[^`\n]*`", "CODE", text)


def hash_comments(text: str) -> str:
    """Return the comments after a ``#``, one a line."""
    return "\n".join(line.partition("#")[2] for line in text.splitlines())


def c_comments(text: str) -> str:
    """Return the ``/* */`` comments; other lines are empty."""
    spans = re.split(r"(/\*.*?\*/)", text, flags=re.DOTALL)
    return "".join(span if number % 2 else "\n" * span.count("\n") for number, span in enumerate(spans))


def faults(text: str) -> list[str]:
    """Return ``LINE: 'WORDS' in: CONTEXT`` of each phrase that is not plain English."""
    return [
        f"{text.count(NEWLINE, 0, found.start()) + 1}: {found[0]!r} in: "
        + " ".join(text[max(0, found.start() - 40) : found.end() + 40].split())
        for found in IDIOM.finditer(text)
    ]


@pytest.mark.parametrize("path", PAGES, ids=name_of)
def test_a_page_is_plain_english(path: Path) -> None:
    assert not faults(prose_of_page(path))


@pytest.mark.parametrize("path", TEXTS, ids=name_of)
def test_a_playbook_or_unit_is_plain_english(path: Path) -> None:
    """The whole text: task names, messages and comments."""
    assert not faults(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("path", HASH_COMMENTED, ids=name_of)
def test_comments_and_help_after_a_hash_are_plain_english(path: Path) -> None:
    assert not faults(hash_comments(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", C_COMMENTED, ids=name_of)
def test_comments_of_the_firmware_are_plain_english(path: Path) -> None:
    assert not faults(c_comments(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", SCRIPTS, ids=name_of)
def test_docstrings_of_scripts_and_kernel_tests_are_plain_english(path: Path) -> None:
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, documented) and (text := ast.get_docstring(node)):
            assert not faults(text)
            assert not FIRST_WORDS.match(text), text.splitlines()[0]


@pytest.mark.parametrize(
    ("read", "text", "line"),
    [
        (hash_comments, "release_ms = 500  # opens when it is\nsay = 1  # told to", "1"),
        (hash_comments, "fuses:  ## what FUSES in main.c says", "1"),
        (c_comments, "int say;\n/* what the\n   target says */\nint heard;", "3"),
    ],
)
def test_the_old_idiom_is_found_in_comments_alone(read: Callable[[str], str], text: str, line: str) -> None:
    assert [fault.split(":")[0] for fault in faults(read(text))] == [line]


def test_code_on_a_page_is_not_read(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("`say` is a key.\n```sh\nsay hello\n```\nIt says so.\n")
    assert [fault.split(":")[0] for fault in faults(prose_of_page(page))] == ["5"]
