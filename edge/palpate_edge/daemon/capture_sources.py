"""Registry of capture sources by their name in a fingertip's configuration (`CaptureConfig.source`).

Another package adds a source under the entry-point group ``palpate_edge.capture_sources``; CONTRIBUTING.md
has a worked example. Openers are imported when they are needed, since each brings its own libraries.
"""

from __future__ import annotations

from importlib import import_module
from importlib.metadata import entry_points
from typing import Any

from palpate_edge.common.errors import ConfigError

GROUP = "palpate_edge.capture_sources"
OWN_SOURCES = {
    "v4l2": "palpate_edge.daemon.capture_factory:open_camera",
    "recorded": "palpate_edge.daemon.capture_factory:open_recorded",
    "shared_memory": "palpate_edge.daemon.capture_factory:open_ring",
}
"""Name -> ``module:function`` of the sources that are part of palpate."""


def source_names() -> list[str]:
    """Return the names of all sources: palpate's own, then those of other packages."""
    return [*OWN_SOURCES, *sorted({point.name for point in entry_points(group=GROUP)} - OWN_SOURCES.keys())]


def find_opener(name: str) -> Any:
    """Return the function that opens the source `name`; its signature is `SourceOpener`.

    Raises ConfigError when no installed package has that source, or when the package cannot be imported.
    """
    try:
        if name in OWN_SOURCES:
            module, _, function = OWN_SOURCES[name].partition(":")
            return getattr(import_module(module), function)
        for point in entry_points(group=GROUP, name=name):
            return point.load()
    except (ImportError, AttributeError) as exc:
        raise ConfigError(
            f"capture.source = {name!r} cannot be imported ({exc}): repair the package that provides it"
        ) from exc
    raise ConfigError(f"capture.source = {name!r} is not one of {', '.join(source_names())}")
