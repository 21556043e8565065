"""A TOML file as a checked configuration: every refusal names file, key and way out in one line."""

from __future__ import annotations

from pathlib import Path
from typing import TypeVar

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_edge.common.file_permissions import refuse_unsafe

T = TypeVar("T")


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A table of a configuration file: immutable; unknown keys are refused."""


def read_toml(path: Path, kind: type[T], *, option: str, example: str) -> T:
    """The file as a `kind`; ConfigError when it is missing, garbled, writable by everybody, or has a wrong,
    unknown or missing key.

    option: what gives the file, as `the hand's file with --config`; example: where its keys stand, as a
    clause.
    """
    try:
        refuse_unsafe(path)
        return msgspec.toml.decode(path.read_bytes(), type=kind)
    except OSError as exc:
        raise ConfigError(f"{path}: cannot be read ({exc.strerror}): give {option}") from exc
    except UnicodeDecodeError as exc:
        raise ConfigError(f"{path}: is not UTF-8 text: save it as plain TOML") from exc
    except msgspec.ValidationError as exc:
        raise ConfigError(f"{path}: {exc}: correct that key ({example})") from exc
    except msgspec.DecodeError as exc:
        raise ConfigError(f"{path}: is not valid TOML ({exc}): correct that line") from exc
