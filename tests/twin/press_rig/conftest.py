"""A simulated sensor, and a press rig in virtual time."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.twin.press_rig.rig_trial import RigTrial

from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.dome.library import load_library
from palpate_twin.press_rig.virtual_rig import Placement


@pytest.fixture(scope="session")
def view() -> CameraView:
    return CameraView(random_sensor(302), load_library())


@pytest.fixture
def trial(tmp_path: Path, view: CameraView) -> RigTrial:
    return RigTrial(tmp_path / "presses", view, Placement(), presses=6)
