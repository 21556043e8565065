"""Parts that other packages plug into palpate-host by entry point; the host never imports them."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any

from palpate_edge.common.errors import ConfigError

COMMANDS, SIMULATORS = "palpate_host.commands", "palpate_host.simulators"


def load_plugin(group: str, name: str) -> Any:
    """Return the object that an installed package registers as `name` in the entry-point `group`.

    Raises ConfigError when no installed package provides it.
    """
    for entry_point in entry_points(group=group, name=name):
        return entry_point.load()
    raise ConfigError(f"no installed package provides {name!r} ({group}): reinstall palpate")
