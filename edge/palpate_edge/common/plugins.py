"""Load a part by its name: palpate's own from a table, those of other packages by entry point.

The part is imported only when it is loaded, since each brings its own libraries. The search for parts of
other packages imports importlib.metadata with 34 modules more, so that import waits as well.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any

from palpate_edge.common.errors import ConfigError, MissingExtraError, missing_library

NONE_OWN: Mapping[str, str] = MappingProxyType({})


def load_part(group: str, name: str, choice: str, own: Mapping[str, str] = NONE_OWN) -> Any:
    """Return the object that is registered as `name`.

    group: the entry-point group of other packages. choice: how errors call the choice of that name, as in
    ``capture.source = "v4l2"``. own: name -> ``module:attribute`` of palpate's own parts, which take
    precedence. Raises ConfigError when no installed package has the part, or when its package cannot be
    imported.
    """
    try:
        if name in own:
            module, _, attribute = own[name].partition(":")
            return getattr(import_module(module), attribute)
        part = find_part(group, name)
        if part is not None:
            return part
    except (ImportError, AttributeError) as exc:
        if isinstance(exc, ImportError) and (library := missing_library(exc)):
            raise MissingExtraError(choice, library) from exc
        raise ConfigError(
            f"{choice} cannot be imported ({exc}): repair or install the package that provides it"
        ) from exc
    names = ", ".join(part_names(group, own)) or "the installed ones (there are none)"
    raise ConfigError(
        f"{choice} is not one of {names}:"
        f" correct the name, or install the package that provides it (entry-point group {group})"
    )


def find_part(group: str, name: str) -> Any | None:
    """Return the object that another package registers as `name`, None when no package does."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - see above

    for entry_point in entry_points(group=group, name=name):
        return entry_point.load()
    return None


def part_names(group: str, own: Mapping[str, str] = NONE_OWN) -> list[str]:
    """Return the names of all parts: palpate's own in their order, then those of other packages, sorted."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - see above

    return [*own, *sorted({point.name for point in entry_points(group=group)} - own.keys())]
