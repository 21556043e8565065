"""Words for keys, values and types in error messages: what was given, and what is allowed in its place."""

from __future__ import annotations

import dataclasses
import enum
import re
from collections.abc import Sequence
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import msgspec

Key = tuple[str | int, ...]
"""Names of sections and keys, and places in lists, from the file's top."""

_LONGEST_SHOWN = 40
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def key_text(key: Key) -> str:
    """Return the key as in ``fingers[0].joints[1].name``."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if _BARE_KEY.fullmatch(part) else _quoted(part)
            text += f".{name}" if text else name
    return text or "the file"


def allowed_text(kind: Any) -> str:
    """Return what is allowed, as the end of ``it must be ...``; a ``Meta(description=...)`` goes ahead."""
    inner, metas = unwrapped(kind)
    origin = get_origin(inner)
    described = [meta.description for meta in metas if meta.description]
    if described:
        text = described[0]
    elif is_choice(inner):
        text = ", ".join(map(str, choices(inner)))
    elif origin in (Union, UnionType):
        text = ", or ".join(allowed_text(option) for option in get_args(inner) if option is not NoneType)
    elif inner in (int, float):
        text = ("a whole number" if inner is int else "a number") + _bounds(metas)
    elif inner is str:
        text = "text in quotes" + (", not empty" if any(meta.min_length for meta in metas) else "")
    elif origin is tuple and get_args(inner)[-1:] != (...,):
        text = f"a list of {len(get_args(inner))} values"
    else:
        names = {bool: "true or false", bytes: "base64 text", NoneType: "empty", dict: "a section"}
        text = names.get(origin or inner, "a list")
    return text


def _bounds(metas: Sequence[msgspec.Meta]) -> str:
    for meta in metas:
        if meta.ge is not None and meta.le is not None:
            return f" from {meta.ge:g} to {meta.le:g}" if meta.le < 10**6 else f" from {meta.ge} to {meta.le}"
        if meta.gt is not None:
            return f" above {meta.gt:g}"
        if meta.ge is not None:
            return f" of at least {meta.ge:g}"
        if meta.le is not None:
            return f" of at most {meta.le:g}"
    return ""


def unwrapped(kind: Any) -> tuple[Any, list[msgspec.Meta]]:
    if get_origin(kind) is not Annotated:
        return kind, []
    inner, *metas = get_args(kind)
    return inner, [meta for meta in metas if isinstance(meta, msgspec.Meta)]


def is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and (issubclass(kind, msgspec.Struct) or dataclasses.is_dataclass(kind))


def choices(kind: Any) -> tuple[object, ...]:
    """Return the values of a Literal or an enum in the order of their definition."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return tuple(option.value for option in kind)


def is_choice(kind: Any) -> bool:
    return get_origin(kind) is Literal or (isinstance(kind, type) and issubclass(kind, enum.Enum))


def section_kind(kind: Any) -> bool | None:
    """Return whether a key's sections are a list of them; None when the key is no section."""
    inner, _ = unwrapped(kind)
    if is_struct(inner):
        return False
    options = get_args(inner)
    if get_origin(inner) in (tuple, list) and options and is_struct(unwrapped(options[0])[0]):
        return True
    if get_origin(inner) in (Union, UnionType) and any(is_struct(option) for option in options):
        return False
    return None


def place_text(key: Key, kind: Any) -> str:
    """Return ``[capture]`` for a section, ``[[fingers]]`` for a list of them, ``capture.path`` for a key."""
    is_list = section_kind(kind)
    return key_text(key) if is_list is None else section_header(key, is_list=is_list)


def section_header(key: Key, *, is_list: bool) -> str:
    """Return the TOML header of a section; its place in a list of sections is left out."""
    name = key_text(tuple(part for part in key if isinstance(part, str)))
    return f"[[{name}]]" if is_list else f"[{name}]"


def value_text(value: object) -> str:
    """Return a value as TOML writes it, shortened; lists and sections by their size."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, dict):
        return "{...}"
    if isinstance(value, list):
        return f"[{len(value)} entries]" if value else "[]"
    if value is None:
        return "null"
    text = str(value) if not isinstance(value, int) or abs(value) < 10**_LONGEST_SHOWN else "a huge number"
    return text[:_LONGEST_SHOWN]


def _quoted(text: str) -> str:
    text = text if len(text) <= _LONGEST_SHOWN else text[: _LONGEST_SHOWN - 3] + "..."
    return '"' + "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text) + '"'
