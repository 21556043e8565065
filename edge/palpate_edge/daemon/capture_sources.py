"""Registry of capture sources by their name in a fingertip's configuration (`CaptureConfig.source`).

Another package adds a source under the entry-point group ``palpate_edge.capture_sources``; CONTRIBUTING.md
has a worked example.
"""

from __future__ import annotations

from typing import Any

from palpate_edge.common.plugins import load_part, part_names

GROUP = "palpate_edge.capture_sources"
OWN_SOURCES = {
    "v4l2": "palpate_edge.daemon.capture_factory:open_camera",
    "recorded": "palpate_edge.daemon.capture_factory:open_recorded",
    "shared_memory": "palpate_edge.daemon.capture_factory:open_ring",
}
"""Name -> ``module:function`` of the sources that are part of palpate."""


def source_names() -> list[str]:
    """Return the names of all sources: palpate's own, then those of other packages."""
    return part_names(GROUP, OWN_SOURCES)


def find_opener(name: str) -> Any:
    """Return the function that opens the source `name`; its signature is `SourceOpener`.

    Raises ConfigError when no installed package has that source, or when the package cannot be imported.
    """
    return load_part(GROUP, name, f"capture.source = {name!r}", OWN_SOURCES)
