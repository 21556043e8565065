"""Explain in one line why plain data (dicts, lists, numbers, text) does not fit a msgspec struct.

Types that are understood: msgspec structs (tagged ones too), enums, Literal, unions, tuples, lists, dicts,
numbers with bounds, text with a length or a pattern.
"""

from __future__ import annotations

import binascii
import dataclasses
import difflib
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec

from palpate_edge.common.type_text import (
    Key,
    allowed_text,
    choices,
    is_choice,
    is_struct,
    key_text,
    place_text,
    section_header,
    section_kind,
    unwrapped,
    value_text,
)

_LARGEST = int(sys.float_info.max)


def struct_fault(value: object, kind: Any) -> str | None:
    """Return the first fault of `value` as a `kind`: key, value and what is allowed; None when it fits."""
    return next(_faults(value, kind, ()), None)


def _faults(value: object, kind: Any, key: Key) -> Iterator[str]:
    inner, metas = unwrapped(kind)
    origin = get_origin(inner)
    if is_struct(inner):
        yield from _struct_faults(value, inner, key)
    elif origin in (Union, UnionType):
        yield from _union_faults(value, inner, key)
    elif origin in (tuple, list) and isinstance(value, list):
        yield from _list_faults(value, inner, metas, key)
    elif origin is dict and isinstance(value, dict):
        for name, part in value.items():
            yield from _faults(part, get_args(inner)[1], (*key, name))
    elif not _has_type(value, inner):
        if is_choice(inner):
            yield f"{key_text(key)} = {value_text(value)} is not one of {allowed_text(kind)}"
        else:
            yield f"{key_text(key)} = {value_text(value)} is not {allowed_text(kind)}"
    elif not _in_bounds(value, metas):
        yield f"{key_text(key)} = {value_text(value)} is out of range: it must be {allowed_text(kind)}"


def _struct_faults(value: object, kind: Any, key: Key) -> Iterator[str]:
    if not isinstance(value, dict):
        place = f" {section_header(key, is_list=False)}" if key else " of keys"
        yield f"{key_text(key)} = {value_text(value)} is not a section{place}"
        return
    fields = _fields(kind)
    if _refuses_unknown_keys(kind):
        known = {name: field_type for name, (field_type, _) in fields.items()}
        for name, part in value.items():
            if name not in known and name != kind.__struct_config__.tag_field:
                yield _unknown((*key, name), part, known)
    for name, (field_type, is_required) in fields.items():
        if name in value:
            yield from _faults(value[name], field_type, (*key, name))
        elif is_required:
            yield _missing((*key, name), field_type)


def _fields(kind: Any) -> dict[str, tuple[Any, bool]]:
    """Return the type of each key of a struct or a dataclass, and whether it must be given."""
    types = get_type_hints(kind, include_extras=True)
    if dataclasses.is_dataclass(kind):
        missing = dataclasses.MISSING
        return {
            field.name: (types[field.name], field.default is missing and field.default_factory is missing)
            for field in dataclasses.fields(kind)
        }
    return {field.encode_name: (types[field.name], field.required) for field in msgspec.structs.fields(kind)}


def _refuses_unknown_keys(kind: Any) -> bool:
    return not dataclasses.is_dataclass(kind) and bool(kind.__struct_config__.forbid_unknown_fields)


def _unknown(key: Key, value: object, known: dict[str, Any]) -> str:
    name = str(key[-1])
    is_list = isinstance(value, list) and bool(value) and all(isinstance(part, dict) for part in value)
    is_section = is_list or isinstance(value, dict)
    text = (
        f"unknown section {section_header(key, is_list=is_list)}"
        if is_section
        else f"unknown key {key_text(key)}"
    )
    near = _nearest(name, known)
    if near is not None:
        return f"{text}; did you mean {place_text((*key[:-1], near), known[near])}?"
    where = f"{section_header(key[:-1], is_list=False)} has" if key[:-1] else "the file has"
    return f"{text}; {where} {', '.join(known)}"


def _nearest(name: str, known: Iterable[str]) -> str | None:
    """Return the known name that `name` was probably meant to be; case and underscores do not count."""
    plain = {one.replace("_", "").lower(): one for one in known}
    found = difflib.get_close_matches(name.replace("_", "").lower(), plain, n=1)
    return plain[found[0]] if found else None


def _missing(key: Key, kind: Any) -> str:
    if section_kind(kind) is not None:
        return f"section {place_text(key, kind)} is missing"
    return f"key {key_text(key)} ({allowed_text(kind)}) is missing"


def _union_faults(value: object, kind: Any, key: Key) -> Iterator[str]:
    options = [option for option in get_args(kind) if option is not NoneType]
    if value is None and NoneType in get_args(kind):
        return
    if any(struct_fault(value, option) is None for option in options):
        return
    if len(options) == 1:
        yield from _faults(value, options[0], key)
    elif all(map(is_struct, options)) and isinstance(value, dict):
        yield from _tagged_faults(value, options, key)
    else:
        right_type = any(_has_type(value, unwrapped(option)[0]) for option in options)
        verb = "is out of range: it must be" if right_type else "is not"
        yield f"{key_text(key)} = {value_text(value)} {verb} {allowed_text(kind)}"


def _tagged_faults(value: dict[str, object], options: Sequence[Any], key: Key) -> Iterator[str]:
    """Yield the faults of an object whose tag selects one of several structs."""
    tags = {option.__struct_config__.tag: option for option in options}
    name = options[0].__struct_config__.tag_field
    tag, names = value.get(name), ", ".join(tags)
    if name not in value:
        yield f"key {key_text((*key, name))} (one of {names}) is missing"
    elif isinstance(tag, str) and tag in tags:
        yield from _struct_faults(value, tags[tag], key)
    else:
        yield f"{key_text((*key, name))} = {value_text(tag)} is not one of {names}"


def _list_faults(value: list[object], kind: Any, metas: Sequence[msgspec.Meta], key: Key) -> Iterator[str]:
    options = get_args(kind)
    if get_origin(kind) is tuple and options[-1:] != (...,):
        if len(value) != len(options):
            yield f"{key_text(key)} has {len(value)} entries, not {len(options)}"
        pairs = zip(value, options, strict=False)
    else:
        pairs = zip(value, [options[0]] * len(value), strict=True)
        fewest = max((meta.min_length or 0 for meta in metas), default=0)
        if len(value) < fewest:
            yield f"{key_text(key)} has {len(value)} entries; it needs at least {fewest}"
    for number, (part, option) in enumerate(pairs):
        yield from _faults(part, option, (*key, number))


def _has_type(value: object, kind: Any) -> bool:
    """Return whether msgspec takes the value for this type, bounds aside."""
    if kind is Any or kind is NoneType:
        return kind is Any or value is None
    if is_choice(kind):
        return any(type(value) is type(option) and value == option for option in choices(kind))
    if kind is bytes:
        return isinstance(value, str) and _is_base64(value)
    if kind in (int, float):
        return _is_number(value, kind)
    return isinstance(kind, type) and isinstance(value, kind)


def _is_number(value: object, kind: type) -> bool:
    """Return whether msgspec takes the value for an int or a float."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    return isinstance(value, int) if kind is int else isinstance(value, float) or abs(value) <= _LARGEST


def _in_bounds(value: Any, metas: Sequence[msgspec.Meta]) -> bool:
    for meta in metas:
        if not (
            (meta.gt is None or value > meta.gt)
            and (meta.ge is None or value >= meta.ge)
            and (meta.lt is None or value < meta.lt)
            and (meta.le is None or value <= meta.le)
            and (meta.min_length is None or len(value) >= meta.min_length)
            and (meta.max_length is None or len(value) <= meta.max_length)
            and (meta.pattern is None or re.search(meta.pattern, value) is not None)
        ):
            return False
    return True


def _is_base64(text: str) -> bool:
    try:
        binascii.a2b_base64(text, strict_mode=True)
    except (binascii.Error, ValueError):
        return False
    return True
