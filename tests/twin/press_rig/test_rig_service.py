"""The commands on pseudo terminals: palpate-edge press-rig against palpate-host simulate press-rig."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from tests.twin.press_rig.conftest import ServedRig

from palpate_edge.cli.main import cli
from palpate_edge.datasets.press_dataset import read_dataset

pytestmark = pytest.mark.long


def _press(folder: Path, *options: str) -> Result:
    files = ["--config", folder / "finger.toml", "--rig", folder / "rig.toml", "-o", folder / "presses"]
    return CliRunner().invoke(cli, ["press-rig", *map(str, files), *options])


@pytest.mark.slow
def test_the_commands_make_a_press_dataset(served_rig: ServedRig) -> None:
    folder = served_rig.folder
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
