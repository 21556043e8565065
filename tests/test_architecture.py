"""The house: rooms of a size that can be read, one name for one class, docstrings whose names exist."""

from __future__ import annotations

import ast
import builtins
import importlib
import re
import sys
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from tests.syntax_trees import nodes_of, parsed

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = tuple(
    ROOT / path
    for path in ("edge/palpate_edge", "host/palpate_bus", "host/palpate_host", "host/palpate_twin")
)
ROOMS = sorted(path.parent for package in PACKAGES for path in package.glob("*/__init__.py"))
PLUGINS = (ROOT / "integrations/lerobot_robot_palpate/lerobot_robot_palpate",)
FILES = sorted(path for package in (*PACKAGES, *PLUGINS) for path in package.rglob("*.py"))
OTHER_CODE = ("bench", "tests", "firmware", "ansible", "ros")
CODE = [*FILES, *(path for part in OTHER_CODE for path in (ROOT / part).rglob("*.py"))]
MOST_MODULES = 20
LARGER_ROOMS = {"node"}
"""One CiA service a file, each in the words of its standard."""
LARGEST_SHARE = 0.15


def room_name(folder: Path) -> str:
    return f"{folder.parent.name}.{folder.name}"


def test_no_class_name_is_used_twice():
    found = Counter(
        node.name for path in FILES for node in nodes_of(parsed(path)) if isinstance(node, ast.ClassDef)
    )
    twice = {name for name, count in found.items() if count > 1}
    assert not twice


@pytest.mark.parametrize("folder", sorted({path.parent for path in FILES}), ids=room_name)
def test_no_folder_has_more_than_twenty_modules(folder):
    modules = [path for path in folder.glob("*.py") if path.name != "__init__.py"]
    assert len(modules) <= MOST_MODULES or folder.name in LARGER_ROOMS


def test_no_room_holds_fifteen_percent_of_the_lines():
    lines = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    of_room = {room: sum(count for path, count in lines.items() if room in path.parents) for room in ROOMS}
    largest = max(of_room, key=lambda room: of_room[room])
    share = of_room[largest] / sum(lines.values())
    assert share < LARGEST_SHARE, f"{room_name(largest)}: {share:.1%}"


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_a_package_root_holds_rooms_and_data_alone(package):
    for entry in package.iterdir():
        if entry.is_file():
            assert entry.name in ("__init__.py", "py.typed"), entry
        elif entry.name != "__pycache__" and entry not in ROOMS:
            assert not list(entry.rglob("*.py")), f"{entry} holds code and no __init__.py"


# Names in docstrings: `single backticks` around an identifier cite something that exists; ``double ones`` are
# literals. A name may be anything that the project defines, a name that the same file uses in its code (which
# mypy has checked), or something of the standard library or of a dependency. When a dotted name begins with a
# class or a module, the rest must be its member. A cited file, such as drive.py, must exist.

CITED = re.compile(r"(?<!`)`([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(?:\(\))?`(?!`)|([\w/]+\.py)\b")


def defined_names(tree: ast.AST) -> Iterator[str]:
    """Yield classes, functions, parameters, variables and attributes that a piece of code defines."""
    for node in ast.walk(tree):
        if isinstance(node, (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def used_names(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a file uses."""
    for node in nodes_of(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.alias):
            yield from (node.asname or node.name).split(".")
        elif isinstance(node, ast.keyword) and node.arg:
            yield node.arg


@cache
def project_names() -> frozenset[str]:
    names = {name for path in FILES for name in defined_names(parsed(path))}
    names |= {path.stem for path in FILES} | {folder.name for path in FILES for folder in path.parents}
    return frozenset(names | set(dir(builtins)))


@cache
def project_classes() -> dict[str, ast.ClassDef]:
    nodes = (node for path in FILES for node in nodes_of(parsed(path)) if isinstance(node, ast.ClassDef))
    return {node.name: node for node in nodes}


def members_of(name: str) -> set[str] | None:
    """Return the members of a class of the project, None when a base class is from elsewhere."""
    node = project_classes()[name]
    members = set(defined_names(node)) | {part.target.id for part in node.body if is_field(part)}
    for base in node.bases:
        base_name = base.id if isinstance(base, ast.Name) else ""
        if base_name in project_classes():
            inherited = members_of(base_name)
            if inherited is None:
                return None
            members |= inherited
        elif base_name not in ("Protocol", "Enum", "object"):
            return None
    return members


def is_field(node: ast.stmt) -> bool:
    return isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)


def is_member(first: str, rest: list[str], path: Path) -> bool | None:
    """Return whether a class or module has these members; None when `first` is neither."""
    if first in project_classes():
        members = members_of(first)
        return members is None or rest[0] in members
    if first in sys.stdlib_module_names or first in imported_modules(path):
        value: object = importlib.import_module(imported_modules(path).get(first, first))
        for part in rest:
            if not hasattr(value, part):
                try:
                    value = importlib.import_module(f"{getattr(value, '__name__', '')}.{part}")
                except ImportError:
                    return False
            else:
                value = getattr(value, part)
        return True
    return None


def imported_modules(path: Path) -> dict[str, str]:
    """Return the modules that a file imports by the names that it gives them."""
    nodes = (node for node in nodes_of(parsed(path)) if isinstance(node, ast.Import))
    return {
        alias.asname or alias.name.split(".")[0]: alias.name if alias.asname else alias.name.split(".")[0]
        for node in nodes
        for alias in node.names
    }


def resolves(name: str, path: Path) -> bool:
    if name.endswith(".py"):
        return any(str(file).endswith(f"/{name}") for file in CODE)
    first, *rest = name.split(".")
    if rest:
        known = is_member(first, rest, path)
        if known is not None:
            return known
    return known_names(path).issuperset((first, *rest))


@cache
def known_names(path: Path) -> frozenset[str]:
    """Return the names of the project, and those that a file uses."""
    return project_names().union(used_names(parsed(path)))


def cited(text: str) -> list[str]:
    """Return the names and the Python files that a docstring cites."""
    return [name or file for name, file in CITED.findall(text)]


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and text of every string that stands as a statement: docstrings, also those of constants."""
    for node in nodes_of(parsed(path)):
        match node:
            case ast.Expr(value=ast.Constant(value=str(text))):
                yield node.lineno, text


@pytest.mark.parametrize("room", [*ROOMS, *PLUGINS], ids=room_name)
def test_names_in_docstrings_exist(room):
    unknown = [
        f"{path.relative_to(ROOT)}:{line}: `{name}`"
        for path in sorted(room.rglob("*.py"))
        for line, text in docstrings(path)
        for name in cited(text)
        if not resolves(name, path)
    ]
    assert not unknown, "\n".join(unknown)


def test_a_name_that_does_not_exist_is_found():
    path = ROOT / "host/palpate_host/drives/drive_group.py"
    text = "a `Drive.receive`, ``literal``, `no_such_name`, `x y` (drive.py)"
    assert cited(text) == ["Drive.receive", "no_such_name", "drive.py"]
    for name in ("Drive.receive", "threading.Event.set", "staleness.joint_stop_ms", "drives/drive.py"):
        assert resolves(name, path)
    for name in ("Drive.recieve", "no_such_name", "threading.Evnt", "staleness.no_such_key", "rive.py"):
        assert not resolves(name, path)
