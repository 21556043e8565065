"""The map of the code (docs/overview.md, docs/rooms.svg) against the code; exports of every room."""

from __future__ import annotations

import importlib
from pathlib import Path

import mujoco  # noqa: F401 - starts a process when it is imported, to find its window library
import pytest
from bench.rooms import PAGE, PICTURE, filled, modules, picture, rooms

ROOMS = rooms()
NAMES = [f"{room.package}.{room.name}" for room in ROOMS]
IMPORTED = [pytest.param(name, marks=pytest.mark.process if name.endswith(".view") else ()) for name in NAMES]
"""rerun-sdk starts a process when it is imported."""


def test_the_map_is_of_this_code() -> None:
    """When it is not: python -m bench.rooms."""
    assert PAGE.read_text(encoding="utf-8") == filled(PAGE.read_text(encoding="utf-8"))
    assert PICTURE.read_text(encoding="utf-8") == picture()


@pytest.mark.parametrize("name", IMPORTED)
def test_a_room_states_its_subject_and_exports_its_names(name: str) -> None:
    module = importlib.import_module(name)
    text = " ".join((module.__doc__ or "").split())
    assert "Belongs here:" in text
    assert "May use:" in text
    folder = Path(module.__file__ or "").parent
    submodules = {path.stem for path in folder.iterdir()}
    for exported in module.__all__:
        assert exported not in submodules, f"{name}.{exported} is a module as well"
        assert getattr(module, exported) is not None


@pytest.mark.parametrize("room", ROOMS, ids=NAMES)
def test_every_module_of_a_room_has_a_subject(room) -> None:
    for path in modules(room.folder):
        assert path.read_text(encoding="utf-8").startswith('"""'), path
