"""The mutants of a source file: copies with one operator, constant or statement changed.

Annotations, docstrings, `__all__`, decorators, texts, logging calls and what stands under `if TYPE_CHECKING`
are left alone: changing them changes no behaviour that a test should notice.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}
EXTREMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}
LOGGERS = {"log", "logger", "logging", "_log", "_logger"}
SKIPPED_FIELDS = {"annotation", "returns", "decorator_list"}
TEXTS = (ast.JoinedStr, ast.List, ast.Tuple)


@dataclass(frozen=True)
class Mutant:
    """A change of one place of a file.

    line: of the changed node; statement_line: of the statement that holds it. before, after: the changed
    lines as one. in_function: whether the place runs in a call, not at import. text: the whole new file.
    """

    path: str
    line: int
    statement_line: int
    operator: str
    before: str
    after: str
    in_function: bool
    text: str


@dataclass(frozen=True)
class _Place:
    """Surroundings of a node: its statement's first line, and whether its function has a result."""

    statement_line: int = 1
    in_function: bool = False
    returns_value: bool = False


_Change = tuple[ast.AST, str, str, _Place]  # node to replace, its new text, name of the operator, place


def mutants_of(root: Path, path: str) -> Iterator[Mutant]:
    """Return the mutants of a source file, given relative to root."""
    source = (root / path).read_text()
    lines = source.encode().splitlines(keepends=True)
    for node, new, operator, place in _changes(ast.parse(source), _Place()):
        first, last = node.lineno - 1, node.end_lineno - 1  # type: ignore[attr-defined]
        head = lines[first][: node.col_offset]  # type: ignore[attr-defined]
        tail = lines[last][node.end_col_offset :]  # type: ignore[attr-defined]
        changed = head + new.encode() + tail
        text = b"".join([*lines[:first], changed, *lines[last + 1 :]]).decode()
        before = _as_one(b"".join(lines[first : last + 1]))
        yield Mutant(
            path, first + 1, place.statement_line, operator, before, _as_one(changed), place.in_function, text
        )


def _as_one(lines: bytes) -> str:
    return " ".join(lines.decode().split())


def _changes(node: ast.AST, place: _Place) -> Iterator[_Change]:
    if _is_skipped(node):
        return
    if isinstance(node, ast.stmt):
        place = _Place(node.lineno, place.in_function, place.returns_value)
    yield from _changes_here(node, place)
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        yield from _children(node.args, place)
        returns_value = node.returns is not None and ast.unparse(node.returns) != "None"
        place = _Place(node.lineno, in_function=True, returns_value=returns_value)
        for statement in node.body:
            yield from _changes(statement, place)
    elif isinstance(node, ast.ClassDef):  # its keywords say what kind of class it is
        for statement in node.body:
            yield from _changes(statement, place)
    else:
        yield from _children(node, place)


def _children(node: ast.AST, place: _Place) -> Iterator[_Change]:
    for field, value in ast.iter_fields(node):
        if field not in SKIPPED_FIELDS:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _changes(child, place)


def _is_skipped(node: ast.AST) -> bool:
    match node:
        case ast.Expr(ast.Constant()) | ast.JoinedStr() | ast.arg():
            return True
        case ast.If(test):
            return "TYPE_CHECKING" in ast.unparse(test)
        case ast.Assign([ast.Name("__all__")]) | ast.keyword("strict"):
            return True
        case ast.Expr(ast.Call(ast.Attribute(ast.Name(name)))):
            return name in LOGGERS
    return False


def _changes_here(node: ast.AST, place: _Place) -> Iterator[_Change]:
    if isinstance(node, ast.stmt):
        yield from _statement_changes(node, place)
        return
    for new, operator in _expressions(node):
        yield node, f"({new})", operator, place


def _statement_changes(node: ast.stmt, place: _Place) -> Iterator[_Change]:
    match node:
        case ast.Expr(ast.Yield() | ast.YieldFrom() | ast.Await()):
            pass
        case ast.Expr():
            yield node, "pass", "removed call", place
        case ast.Assign(targets) if all(isinstance(target, ast.Attribute) for target in targets):
            yield node, "pass", "removed assignment", place
        case ast.AugAssign(ast.Attribute()) | ast.AnnAssign(ast.Attribute(), value=ast.expr()):
            yield node, "pass", "removed assignment", place
        case ast.Return(ast.expr() as value) if place.returns_value:
            if not (isinstance(value, ast.Constant) and value.value is None):
                yield node, "return None", "return None", place
    if isinstance(node, ast.AugAssign) and type(node.op) in ARITHMETIC:
        new = ast.AugAssign(node.target, ARITHMETIC[type(node.op)](), node.value)
        yield node, ast.unparse(ast.fix_missing_locations(new)), "arithmetic", place


def _expressions(node: ast.AST) -> Iterator[tuple[str, str]]:
    """Yield what an expression may become, as source, and the operator's name."""
    match node:
        case ast.Compare(left, ops, comparators):
            for index, op in enumerate(ops):
                if type(op) in COMPARISONS:
                    swapped = [*ops[:index], COMPARISONS[type(op)](), *ops[index + 1 :]]
                    yield ast.unparse(ast.Compare(left, swapped, comparators)), "comparison"
        case ast.BinOp(left, op, right) if type(op) in ARITHMETIC and not (_is_text(left) or _is_text(right)):
            yield ast.unparse(ast.BinOp(left, ARITHMETIC[type(op)](), right)), "arithmetic"
        case ast.BoolOp(op, values):
            other = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield ast.unparse(ast.BoolOp(other, values)), "and/or"
        case ast.UnaryOp(ast.Not(), operand):
            yield ast.unparse(operand), "not"
        case ast.Constant(bool() as value):
            yield str(not value), "constant"
        case ast.Constant(int() as value):
            yield str(value + 1), "constant"
        case ast.Constant(float() as value):
            yield repr(value * 1.5 if value else 1.0), "constant"
        case ast.Call(ast.Name(name), args, keywords) if name in EXTREMES:
            yield ast.unparse(ast.Call(ast.Name(EXTREMES[name]), args, keywords)), "extreme"
        case ast.Call(ast.Attribute(value, name), args, keywords) if name in EXTREMES:
            function = ast.Attribute(value, EXTREMES[name])
            yield ast.unparse(ast.Call(function, args, keywords)), "extreme"


def _is_text(node: ast.expr) -> bool:
    """Whether adding to it can only join texts or lists, so that a swap is always an error."""
    return isinstance(node, TEXTS) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
