"""Modules of the LeRobot plug-in that need no LeRobot, imported without the plug-in's package."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

PLUGIN = Path(__file__).resolve().parents[1] / "integrations/lerobot_robot_palpate/lerobot_robot_palpate"


@contextmanager
def plugin_modules() -> Iterator[Callable[[str], ModuleType]]:
    """Yield ``module(name)``; the package's own imports of LeRobot do not run."""
    package = ModuleType(PLUGIN.name)
    package.__path__ = [str(PLUGIN)]
    sys.modules[package.__name__] = package
    try:
        yield lambda name: importlib.import_module(f"{package.__name__}.{name}")
    finally:
        for name in [name for name in sys.modules if name.split(".")[0] == package.__name__]:
            del sys.modules[name]
