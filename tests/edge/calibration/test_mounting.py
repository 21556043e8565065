"""The camera's turn about its axis: azimuths by hand, and drawn sensors whose places are turned."""

from __future__ import annotations

import math

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.mounting import FEWEST_PRESSES, find_mounting
from palpate_edge.cli.main import cli
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.estimator import Estimator


def places(count, theta=0.8, seed=0):
    phi = np.random.default_rng(seed).uniform(-math.pi, math.pi, count)
    return phi, 30 * np.stack(
        [math.sin(theta) * np.cos(phi), math.sin(theta) * np.sin(phi), np.full(count, math.cos(theta))],
        axis=1,
    )


@pytest.mark.parametrize("turn_deg", [-120, -90, -3, 0, 45, 170])
def test_the_turn_is_that_between_image_and_truth(turn_deg):
    phi, places_mm = places(20)
    noise = np.random.default_rng(1).normal(0, 0.05, 20)
    found = find_mounting(phi - math.radians(turn_deg) + noise, places_mm)
    assert math.degrees(found.turn_rad) == pytest.approx(turn_deg, abs=2)
    assert not found.mirrored
    assert found.upright == (abs(turn_deg) < 20)


def test_mirrored_places_are_told():
    phi, places_mm = places(20)
    found = find_mounting(-phi, places_mm)
    assert found.mirrored
    assert not found.upright


@pytest.mark.parametrize(
    ("count", "theta"), [(0, 0.8), (FEWEST_PRESSES - 1, 0.8), (20, 0.1)], ids=["none", "few", "apex"]
)
def test_presses_that_cannot_tell_leave_the_camera_upright(count, theta):
    phi, places_mm = places(count, theta)
    assert find_mounting(phi + 2.0, places_mm).upright


def test_contradicting_presses_leave_the_camera_upright():
    _, places_mm = places(40)
    assert find_mounting(np.random.default_rng(3).uniform(-math.pi, math.pi, 40), places_mm).upright


def with_places(dome, folder, change):
    """A drawn dataset whose places and forces are changed in x and y."""
    dome.write(folder, presses=24)
    header, *rows = (folder / "truth.csv").read_text().splitlines()
    lines = [header]
    for row in rows:
        cell = row.split(",")
        for x, y in ((3, 4), (7, 8)):
            if cell[3]:
                cell[x], cell[y] = (f"{value:.4f}" for value in change(float(cell[x]), float(cell[y])))
        lines.append(",".join(cell))
    (folder / "truth.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda x, y: (-y, x), r"turned by \+(8|9)\d deg"),
        (lambda x, y: (y, -x), r"turned by -(8|9)\d deg"),
        (lambda x, y: (-x, -y), r"turned by [+-]1[78]\d deg"),
        (lambda x, y: (x, -y), "mirrored"),
    ],
    ids=["90", "-90", "180", "y up"],
)
def test_a_drawn_layout_with_a_turned_camera_is_refused(drawn_dome, tmp_path, change, said):
    folder = with_places(drawn_dome, tmp_path / "d", change)
    with pytest.raises(CalibrationError, match=said):
        calibrate(read_dataset(folder))


@pytest.mark.long
def test_a_learned_layout_is_turned_with_the_camera(another_dome, tmp_path):
    dome = another_dome()
    folder = with_places(dome, tmp_path / "d", lambda x, y: (-y, x))
    text = (folder / "sensor.toml").read_text()
    start = text.index("rings")
    (folder / "sensor.toml").write_text(text[:start] + text[text.index("[camera]") :])
    ran = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(tmp_path / "d.cal"), "--no-model"])
    assert ran.exit_code == 0, ran.exception
    assert "camera turned by +9" in ran.output or "camera turned by +8" in ran.output
    dataset = read_dataset(folder)
    estimator = Estimator(calibrate(dataset))
    truth = {press.frame: press.position_mm for press in dataset.presses}
    off_mm = []
    for frame in all_frames(open_recording(folder)):
        contact = estimator.estimate(frame)
        if truth[frame.name] is not None:
            off_mm.append(math.dist(contact.position_mm, truth[frame.name]))
    assert np.median(off_mm) < 3.0


def test_no_presses_are_told(drawn_dome, tmp_path):
    folder = drawn_dome.write(tmp_path / "d")
    ran = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(tmp_path / "d.cal"), "--no-model"])
    assert "no presses: contact positions are not tested on this sensor" in ran.output
