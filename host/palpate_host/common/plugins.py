"""Parts of other packages that palpate-host loads by entry point and never imports by name."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from palpate_edge.common.errors import ConfigError

COMMANDS, SIMULATORS = "palpate_host.commands", "palpate_host.simulators"
DRIVES = "palpate_host.drives"


def load_plugin(group: str, name: str) -> Any:
    """Return the object that an installed package registers as `name` in the entry-point `group`.

    Raises ConfigError when no installed package provides it.
    """
    for entry_point in entry_points(group=group, name=name):
        return entry_point.load()
    raise ConfigError(f"no installed package provides {name!r} ({group}): reinstall palpate")


def plugin_names(group: str) -> list[str]:
    """Return the names that installed packages register in the entry-point `group`, sorted."""
    return sorted({entry_point.name for entry_point in entry_points(group=group)})
