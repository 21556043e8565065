"""A simulated sensor, and a press rig in virtual time."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.twin.press_rig.rig_trial import RigTrial

from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.library import load_library
from palpate_twin.press_rig.rig_service import APEX_MM, serve_rig, write_rig_files
from palpate_twin.press_rig.virtual_rig import Placement, VirtualRig

SPEED = 25.0


@dataclass(frozen=True)
class ServedRig:
    """A simulated rig behind its devices in a folder."""

    folder: Path
    rig: VirtualRig


@pytest.fixture(scope="session")
def view() -> CameraView:
    return CameraView(random_sensor(302), load_library())


@pytest.fixture
def trial(tmp_path: Path, view: CameraView) -> RigTrial:
    return RigTrial(tmp_path / "presses", view, Placement(), presses=6)


@pytest.fixture
def served_rig(tmp_path: Path, view: CameraView) -> Iterator[ServedRig]:
    """A folder with the rig's devices, served by a thread."""
    rig = VirtualRig(view, APEX_MM, Placement(), seed=4)
    write_rig_files(tmp_path, rig)
    stop = threading.Event()
    thread = threading.Thread(target=serve_rig, args=(tmp_path, rig, stop, SPEED))
    thread.start()
    try:
        while not (tmp_path / "frames.ring").exists():
            assert thread.is_alive()
        yield ServedRig(tmp_path, rig)
    finally:
        stop.set()
        thread.join()
    assert not (tmp_path / "printer").is_symlink()
