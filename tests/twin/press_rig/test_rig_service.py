"""The commands on pseudo terminals: palpate-edge press-rig against palpate-host simulate press-rig."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from palpate_edge.cli.main import cli
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_twin.camera.renderer import CameraView
from palpate_twin.press_rig.rig_service import APEX_MM, serve_rig, write_rig_files
from palpate_twin.press_rig.virtual_rig import Placement, VirtualRig

pytestmark = pytest.mark.long

SPEED = 25.0


@pytest.fixture
def folder(tmp_path: Path, view: CameraView) -> Iterator[Path]:
    """A folder with the rig's devices, served by a thread."""
    rig = VirtualRig(view, APEX_MM, Placement(), seed=4)
    write_rig_files(tmp_path, rig)
    stop = threading.Event()
    thread = threading.Thread(target=serve_rig, args=(tmp_path, rig, stop, SPEED))
    thread.start()
    try:
        while not (tmp_path / "frames.ring").exists():
            assert thread.is_alive()
        yield tmp_path
    finally:
        stop.set()
        thread.join()
    assert not (tmp_path / "printer").is_symlink()


def _press(folder: Path, *options: str) -> Result:
    files = ["--config", folder / "finger.toml", "--rig", folder / "rig.toml", "-o", folder / "presses"]
    return CliRunner().invoke(cli, ["press-rig", *map(str, files), *options])


def test_the_commands_make_a_press_dataset(folder: Path) -> None:
    result = _press(folder, "--presses", "12", "--test-presses", "2", "--yes")
    assert result.exit_code == 0, result.output + repr(result.exception)
    assert "dome found: centre at 11" in result.stderr
    assert "14 presses; the fingertip leans" in result.stdout
    dataset = read_dataset(folder / "presses")
    assert len(dataset.reference) == 8
    assert len([press for press in dataset.split("train") if press.position_mm]) == 12
    assert len([press for press in dataset.split("test") if press.position_mm]) == 2
    for press in dataset.presses:
        assert (press.normal_force_N or 0.0) >= 0.0
        assert press.probe == ("none" if press.position_mm is None else "sphere5")
