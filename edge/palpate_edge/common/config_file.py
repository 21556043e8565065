"""Read TOML and JSON files into typed structs; a fault becomes one line with file, key and allowed values.

msgspec decides whether a value fits its type; struct_fault.py words the refusal.
"""

from __future__ import annotations

import json
import math
import re
import stat
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from palpate_edge.common.errors import ConfigError, PalpateError, reason_of
from palpate_edge.common.struct_fault import struct_fault
from palpate_edge.common.type_text import key_text

T = TypeVar("T")

_preparing = threading.Lock()
_TOML_PLACE = re.compile(r"(?s)(.*?) \(at (?:line (\d+), column (\d+)|end of document)\)$")


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a configuration file: immutable; unknown keys are refused."""


def read_toml(
    path: Path, kind: type[T], *, guide: str, error: type[PalpateError] = ConfigError, trusted: bool = True
) -> T:
    """Return the TOML file as a `kind`.

    guide: where its keys are described, as ``docs/configuration.md lists every key``.
    trusted: refuse a file that everybody may write. Raises `error` when the file is missing, is not TOML, or
    has an unknown, missing, wrong or out-of-range value.
    """
    try:
        if trusted:
            _refuse_unsafe(path)
        data = path.read_bytes()
    except OSError as refusal:
        raise error(f"{path}: {reason_of(refusal)}; {guide}") from None
    return parse_toml(data, path, kind, guide=guide, error=error)


def _refuse_unsafe(path: Path) -> None:
    """ConfigError when everybody may write this file; OSError as `Path.stat`."""
    mode = path.stat().st_mode
    if mode & stat.S_IWOTH:
        raise ConfigError(
            f"{path} may be written by everybody (mode {stat.S_IMODE(mode):o}): chmod o-w {path}"
        )


def parse_toml(
    data: bytes, path: Path, kind: type[T], *, guide: str, error: type[PalpateError] = ConfigError
) -> T:
    """Return the bytes of a TOML file as a `kind`; arguments and errors as `read_toml`."""
    try:
        plain = tomllib.loads(data.decode("utf-8"))
    except UnicodeDecodeError as refusal:
        line = data.count(b"\n", 0, refusal.start) + 1
        raise error(f"{path}: line {line} is not UTF-8 text: save the file as plain TOML") from None
    except tomllib.TOMLDecodeError as refusal:
        raise error(f"{path}: {_toml_fault(str(refusal))}") from None
    except RecursionError:
        raise error(f"{path}: not valid TOML: brackets are nested too deeply") from None
    except ValueError:  # int() of thousands of digits
        raise error(f"{path}: not valid TOML: a number has too many digits") from None
    not_a_number = next(_nan_keys(plain, ()), None)
    if not_a_number is not None:
        raise error(f"{path}: {key_text(not_a_number)} = nan is not a number; {guide}")
    decoder_of(kind)  # `convert` prepares the type as well
    try:
        return msgspec.convert(plain, kind)
    except msgspec.ValidationError:
        fault = struct_fault(plain, kind) or "a value has a wrong type"
    raise error(f"{path}: {fault}; {guide}" if fault.endswith("missing") else f"{path}: {fault}")


def read_json(path: Path, kind: type[T], *, guide: str, error: type[PalpateError] = ConfigError) -> T:
    """Return the JSON file as a `kind`.

    guide: the way out, as ``make it with palpate-edge calibrate``. Raises `error` when the file is missing,
    is not JSON, or has a missing, wrong or out-of-range value.
    """
    try:
        data = path.read_bytes()
    except OSError as refusal:
        raise error(f"{path}: {reason_of(refusal)}; {guide}") from None
    return decode_json(data, kind, path, guide=guide, error=error)


def decode_json(
    data: bytes, kind: type[T], where: object, *, guide: str, error: type[PalpateError] = ConfigError
) -> T:
    """Return JSON text as a `kind`. Raises `error` with `where`, the fault and the `guide`."""
    try:
        return decoder_of(kind).decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        raise error(f"{where}: {json_fault(data, kind)}; {guide}") from None


def decoder_of(kind: type[T]) -> msgspec.json.Decoder[T]:
    """Return the decoder of JSON text for a type; any thread may ask.

    msgspec (0.22) prepares a struct type when it first meets it. Of two threads that do so at once one reads
    a table that is not finished, and the process ends: here they wait for each other.
    """
    with _preparing:
        return msgspec.json.Decoder(kind)


def json_fault(data: bytes, kind: Any) -> str:
    """Return in one line why `data`, which msgspec has refused, is not the JSON of a `kind`."""
    try:
        plain = json.loads(data)
    except json.JSONDecodeError as refusal:
        return f"line {refusal.lineno}, column {refusal.colno} is not valid JSON: cut short or damaged"
    except UnicodeDecodeError:
        return "not UTF-8 text"
    except (ValueError, RecursionError):
        return "not valid JSON: a number is too long or brackets are nested too deeply"
    return struct_fault(plain, kind) or "a number is too large or not finite"


def _toml_fault(text: str) -> str:
    """Return the parser's words about a TOML syntax error, behind the line."""
    match = _TOML_PLACE.match(text)
    if match is None:
        return f"not valid TOML: {text}"
    reason = match[1][:1].lower() + match[1][1:]
    if match[2] is None:
        return f"not valid TOML: {reason}, at the end of the file"
    return f"line {match[2]}, column {match[3]} is not valid TOML: {reason}"


def _nan_keys(value: object, key: tuple[str | int, ...]) -> Iterator[tuple[str | int, ...]]:
    """Yield the key of every NaN: it passes any comparison with a limit unnoticed."""
    if isinstance(value, dict):
        for name, part in value.items():
            yield from _nan_keys(part, (*key, name))
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _nan_keys(part, (*key, number))
    elif isinstance(value, float) and math.isnan(value):
        yield key
