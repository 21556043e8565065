"""Datasets of simulated sensors, read and calibrated by palpate_edge."""

from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner, Result

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.common.errors import ConfigError, DatasetError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.geometry.sensor import View
from palpate_twin.camera.choose_sensor import choose_sensor
from palpate_twin.camera.look import TWIN_FILE, load_twin
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.cli.simulate import simulate


def _run(*options: str) -> Result:
    return CliRunner().invoke(simulate, ["dataset", *options], catch_exceptions=False)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("twin") / "dome"
    result = _run("-o", str(folder), "--random-seed", "5", "--presses", "10", "--test-presses", "10")
    assert result.exit_code == 0
    assert "85 beads, 22 frames" in result.output
    return folder


def _digest(folder: Path) -> str:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    assert len(files) > 20
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def test_the_edge_reads_what_was_meant(dataset: Path) -> None:
    found, twin = read_dataset(dataset), load_twin(dataset / TWIN_FILE)
    assert found.sensor == twin.sensor == random_sensor(5).sensor
    assert len(found.reference) == 8
    assert [len(found.split(name)) for name in ("train", "test")] == [11, 11]
    touched = [press for press in found.presses if press.position_mm is not None]
    assert len(touched) == 20
    radius_mm = twin.sensor.dome.outer_radius_mm
    for press in touched:
        outward = np.array(press.position_mm) / radius_mm
        assert np.linalg.norm(outward) == pytest.approx(1, abs=1e-4)
        # The force points inwards; its component along the normal is the normal force.
        assert press.normal_force_N == pytest.approx(-np.array(press.force_N) @ outward, abs=1e-3)
        assert press.normal_force_N > 0
        assert cv2.imread(str(found.path(press))).shape == (480, 640, 3)


def test_a_twisting_probe_gives_a_torsion_that_its_friction_can_bear(dataset: Path, tmp_path: Path) -> None:
    """Friction 0.6 at a lever of at most 6 mm beside the force, of both signs; without --twist no column."""
    folder = tmp_path / "twisted"
    _run("-o", str(folder), "--random-seed", "5", "--presses", "8", "--test-presses", "0", "--twist")
    touched = [press for press in read_dataset(folder).presses if press.position_mm is not None]
    levers_mm = [press.torsion_Nmm / press.normal_force_N for press in touched]  # type: ignore[operator]
    assert len(levers_mm) == 8
    assert min(levers_mm) < 0 < max(levers_mm)
    assert max(map(abs, levers_mm)) < 0.6 * 6.0
    assert all(press.torsion_Nmm is None for press in read_dataset(dataset).presses if press.position_mm)


def test_the_edge_finds_the_camera_where_the_twin_has_it(dataset: Path) -> None:
    """Points of the dome's skin are projected with the found pose as with the true one.

    Tilt and offset themselves cannot be separated from one view.
    """
    twin = load_twin(dataset / TWIN_FILE)
    found = calibrate(read_dataset(dataset))
    assert len(found.beads) == len(twin.bead_mm)
    points = 26.5 * np.array([[0, 0, 1.0], [0.5, 0, 0.866], [0, 0.5, 0.866], [-0.6, 0.48, 0.64]])
    theirs = View(twin.sensor.camera, twin.pose).project(points)
    ours = View(twin.sensor.camera, found.pose).project(points)
    nominal = View(twin.sensor.camera).project(points)
    assert np.linalg.norm(ours - theirs, axis=1).max() < 1.5
    assert np.linalg.norm(nominal - theirs, axis=1).max() > 5


def test_the_same_command_gives_the_same_bytes(dataset: Path, tmp_path: Path) -> None:
    again, other = tmp_path / "again", tmp_path / "other"
    _run("-o", str(again), "--random-seed", "5", "--presses", "10", "--test-presses", "10")
    _run(
        "-o",
        str(other),
        "--sensor",
        str(dataset),
        "--presses",
        "10",
        "--test-presses",
        "10",
        "--press-seed",
        "1",
    )
    assert _digest(again) == _digest(dataset) != _digest(other)
    assert (other / TWIN_FILE).read_bytes() == (dataset / TWIN_FILE).read_bytes()


def test_a_sequence_is_a_moving_contact_of_the_same_sensor(dataset: Path, tmp_path: Path) -> None:
    folder = tmp_path / "moving"
    _run("-o", str(folder), "--sensor", str(dataset), "--seconds", "2.4", "--probe", "sphere5", "--hide", "6")
    presses = read_dataset(folder).presses
    assert [press.split for press in presses] == ["test"] * 72
    assert np.diff([press.time_s for press in presses]) == pytest.approx(1 / 30, abs=1e-4)
    touching = [press for press in presses if press.position_mm is not None]
    assert 50 < len(touching) < 65
    assert {press.probe for press in touching} == {"sphere5"}
    assert max(press.lost for press in presses) in range(3, 7)
    steps = np.linalg.norm(np.diff([press.position_mm for press in touching], axis=0), axis=1)
    assert steps.max() < 1.0


def test_a_user_s_own_sensor_toml_is_kept_and_gets_tolerances(dataset: Path, tmp_path: Path) -> None:
    description = dataset / "sensor.toml"
    twins = [choose_sensor(description, seed) for seed in (1, 1, 2)]
    assert twins[0] == twins[1] != twins[2]
    assert twins[0].sensor == twins[2].sensor == load_twin(dataset / TWIN_FILE).sensor


def test_what_cannot_be_used_is_refused_by_name(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="exists"):
        _run("-o", str(dataset))
    bare = tmp_path / "sensor.toml"
    text = (dataset / "sensor.toml").read_text()
    bare.write_text(text[: text.index("rings")] + text[text.index("[camera]") :])
    with pytest.raises(ConfigError, match=r"markers\.rings"):
        choose_sensor(bare, 0)
    broken = tmp_path / TWIN_FILE
    broken.write_text((dataset / TWIN_FILE).read_text().replace("shear_modulus", "stiffness"))
    with pytest.raises(ConfigError, match=r"twin\.json"):
        load_twin(broken)
    with pytest.raises(DatasetError, match="cannot be written"):
        _run("-o", "/proc/nowhere/dome", "--presses", "0", "--test-presses", "0")
