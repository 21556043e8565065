"""Calibration of drawn sensors: the camera, the beads and the presses against what was drawn."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.calibration.evaluation_report import as_table
from palpate_edge.calibration.measurement import DOUBTFUL, NOT_MOVED, NOT_ONE_SKIN
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.cli.main import cli
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.geometry.sensor import View

SIX_EVERYWHERE = ((0, 1, 0), *((4.5 + 5.4 * ring, 6, 30 * (ring % 2)) for ring in range(1, 15)))
TWELVE_EVERYWHERE = ((0, 1, 0), *((15 + 10 * ring, 12, 15 * (ring % 2)) for ring in range(7)))


def calibrate_paper(folder):
    return calibrate(read_dataset(folder))


def error_px(calibration, dome):
    drawn = dome.project(dome.beads_mm())
    return np.linalg.norm(calibration.reference().position_px - drawn, axis=1)


def test_beads_and_camera_are_where_they_were_drawn(drawn_calibration, drawn_dome):
    assert error_px(drawn_calibration, drawn_dome).max() < 0.1
    assert drawn_calibration.residual_px < 0.3
    view = View(drawn_calibration.sensor.camera, drawn_calibration.pose)
    layout = drawn_dome.beads_mm()
    assert np.linalg.norm(view.project(layout) - drawn_dome.project(layout), axis=1).max() < 0.4
    assert drawn_calibration.ring_of().tolist() == [
        ring for ring, (_, count, _) in enumerate(drawn_dome.rings) for _ in range(count)
    ]


def test_its_source_is_told(drawn_calibration):
    source = drawn_calibration.source
    assert (source.dataset, source.reference_frames) == ("dome", 5)
    assert 30 < source.presses <= 45  # three quarters of sixty are train, some touch nothing


def test_presses_that_were_not_trained_on_are_placed_and_weighed(drawn_calibration, drawn_dataset):
    dataset = read_dataset(drawn_dataset)
    estimator = Estimator(drawn_calibration)
    truth = {press.frame: press for press in dataset.presses}
    errors_mm, forces_N = [], []
    for frame in all_frames(open_recording(drawn_dataset)):
        press, contact = truth[frame.name], estimator.estimate(frame)
        assert contact.valid, contact.reason
        assert contact.in_contact == (press.position_mm is not None)
        assert contact.beads_found == 85
        if press.split == "test" and press.position_mm is not None:
            errors_mm.append(math.dist(press.position_mm, contact.position_mm))
            forces_N.append(contact.normal_force_N - press.normal_force_N)
            assert math.hypot(*contact.position_mm) == pytest.approx(30)
            assert math.hypot(*contact.force_N) == pytest.approx(contact.normal_force_N)
            inward = -np.dot(contact.force_N, contact.position_mm) / 30
            assert inward == pytest.approx(contact.normal_force_N)
    assert len(errors_mm) >= 10
    assert np.mean(errors_mm) < 3  # beads are 7 mm apart
    assert np.sqrt(np.mean(np.square(forces_N))) < 1.2  # of up to 2 N: the drawn dent is not the paper's dome


@dataclass(frozen=True)
class Looks:
    bead_bgr: tuple[float, float, float]
    skin_bgr: tuple[float, float, float]
    bright: bool


@pytest.mark.parametrize(
    "looks",
    [
        pytest.param(Looks((235, 240, 240), (110, 105, 115), True), id="bright on dark"),
        pytest.param(Looks((60, 60, 220), (120, 125, 125), False), id="red on grey"),
        pytest.param(Looks((90, 160, 90), (120, 120, 120), True), id="green, as light as the skin"),
    ],
)
def test_how_beads_look_is_found_out(another_dome, tmp_path, looks):
    dome = another_dome(bead_bgr=looks.bead_bgr, skin_bgr=looks.skin_bgr)
    calibration = calibrate_paper(dome.write(tmp_path / "d"))
    assert error_px(calibration, dome).max() < 0.35
    if calibration.appearance.channel == "grey":
        assert calibration.appearance.bright == looks.bright


@pytest.mark.parametrize(
    "rings",
    [
        pytest.param(SIX_EVERYWHERE, id="1+6x14"),
        pytest.param(TWELVE_EVERYWHERE, id="1+7x12", marks=pytest.mark.slow),
    ],
)
def test_other_layouts_of_85_beads(another_dome, tmp_path, rings):
    dome = another_dome(rings=rings, width=640, height=480, focal_px=380.0)
    folder = dome.write(tmp_path / "d", presses=12)
    calibration = calibrate_paper(folder)
    assert len(calibration.beads) == 85
    assert error_px(calibration, dome).max() < 0.2
    estimator = Estimator(calibration)
    for frame, press in zip(all_frames(open_recording(folder)), read_dataset(folder).presses, strict=True):
        contact = estimator.estimate(frame)
        assert contact.valid, contact.reason
        assert contact.in_contact == (press.position_mm is not None)


@pytest.mark.slow
@pytest.mark.long
def test_rings_of_six_spare_beads_that_are_hidden_in_use(another_dome, tmp_path):
    dome = another_dome(rings=SIX_EVERYWHERE, width=640, height=480, focal_px=380.0)
    estimator = Estimator(calibrate_paper(dome.write(tmp_path / "d", presses=30)))
    random, errors_mm = np.random.default_rng(0), []
    for number in range(12):
        theta, phi = random.uniform(0.1, 1.1), random.uniform(-3, 3)
        hidden = tuple(random.choice(85, 10, replace=False))
        image = dome.picture(dome.pressed_mm(theta, phi, 1.5), number, hidden)
        contact = estimator.estimate(Frame(image, 0, number, ""))
        sin = math.sin(theta)
        true = (30 * sin * math.cos(phi), 30 * sin * math.sin(phi), 30 * math.cos(theta))
        errors_mm.append(math.dist(contact.position_mm, true))
    assert np.mean(errors_mm) < 4


@pytest.mark.parametrize("hidden", [(40,), (3, 40, 41, 84), (10, 20, 30, 50, 60, 70, 80)])
def test_beads_hidden_in_the_reference_are_lost_and_the_others_stay_right(another_dome, tmp_path, hidden):
    class PartlyHidden(another_dome().__class__):
        def picture(self, beads_mm, seed, also_hidden=()):
            return super().picture(beads_mm, seed, (*hidden, *also_hidden))

    dome = PartlyHidden()
    folder = dome.write(tmp_path / "d", presses=12)
    calibration = calibrate_paper(folder)
    shown = np.setdiff1d(np.arange(85), hidden)
    assert error_px(calibration, dome)[shown].max() < 0.1
    assert not calibration.appearance.bright
    estimator = Estimator(calibration)
    for frame, press in zip(all_frames(open_recording(folder)), read_dataset(folder).presses, strict=True):
        contact = estimator.estimate(frame)
        assert contact.valid, contact.reason
        assert contact.beads_found == 85 - len(hidden)
        assert contact.in_contact == (press.position_mm is not None)


def test_too_many_hidden_beads_are_refused(another_dome, tmp_path):
    class MostlyHidden(another_dome().__class__):
        def picture(self, beads_mm, seed, _hidden=()):
            return super().picture(beads_mm, seed, tuple(range(0, 85, 4)))

    with pytest.raises(CalibrationError, match=r"of 85 beads of sensor\.toml's layout were recognised"):
        calibrate_paper(MostlyHidden().write(tmp_path / "d"))


def test_a_layout_that_is_not_the_one_in_the_picture_is_refused(drawn_dome, another_dome, tmp_path):
    folder = drawn_dome.write(tmp_path / "d")
    (folder / "sensor.toml").write_text(another_dome(rings=TWELVE_EVERYWHERE).sensor_toml())
    with pytest.raises(CalibrationError, match="were recognised in the reference"):
        calibrate_paper(folder)


def test_without_presses_positions_are_uncorrected_and_force_is_unknown(drawn_dome, drawn_dataset, tmp_path):
    calibration = calibrate_paper(drawn_dome.write(tmp_path / "d"))
    assert calibration.paper.theta == ()
    frame = next(all_frames(open_recording(drawn_dataset)))
    contact = Estimator(calibration).estimate(frame)
    assert contact.in_contact
    assert contact.position_mm is not None
    assert contact.normal_force_N is None
    assert contact.force_N is None


@pytest.mark.parametrize("where", ["reference", "frames"])
def test_a_picture_of_another_size_is_named(drawn_dome, another_dome, tmp_path, where):
    folder = drawn_dome.write(tmp_path / "d", presses=2)
    larger = another_dome(width=330).write(tmp_path / "larger", presses=2)
    name = {"reference": "3.png", "frames": "001.png"}[where]
    (folder / where / name).write_bytes((larger / where / name).read_bytes())
    with pytest.raises(CalibrationError, match=rf"{where}/{name} is 330x240, sensor.toml has 320x240"):
        calibrate_paper(folder)


def test_progress_ends_at_its_total(drawn_dome, tmp_path):
    steps = []
    calibrate(
        read_dataset(drawn_dome.write(tmp_path / "d", presses=4)),
        lambda *step: steps.append(step),
    )
    done, totals = zip(*steps, strict=True)
    assert len(steps) >= 8  # 5 reference frames, 3 presses to train on
    assert list(done) == sorted(set(done))
    assert set(totals) == {done[-1]}


@pytest.mark.parametrize("force", [pytest.param("", marks=pytest.mark.slow), "0"])
@pytest.mark.long
def test_a_dataset_without_newtons_calibrates_position_and_leaves_force_unknown(drawn_dome, tmp_path, force):
    pytest.importorskip("onnxruntime")
    folder = drawn_dome.write(tmp_path / "d", presses=40)
    header, *rows = (folder / "truth.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    (folder / "truth.csv").write_text(
        "\n".join([header, *(",".join([*row[:6], *4 * [force], *row[10:]]) for row in cells)]) + "\n"
    )
    calibration = calibrate(read_dataset(folder), dome=load_dome_model())
    assert calibration.stiffness_scale is None
    assert calibration.contact_threshold_N is None
    assert calibration.paper.theta != ()
    assert calibration.paper.stiffness_N_px == ()
    for method in Method:
        figures = evaluate_dataset(folder, "test", calibration, folder / "d.cal", method)
        assert figures.overall.mean_mm < 3.0
        assert figures.overall.force_rmse_N is None
        assert figures.largest_force_N is None
        assert figures.forces == ()
        assert "force unknown" in as_table(figures)


def test_dropped_presses_are_counted_and_named_by_reason(drawn_dome, tmp_path):
    folder = drawn_dome.write(tmp_path / "d", presses=24)
    unmoved, beads_mm = folder / "reference" / "0.png", drawn_dome.beads_mm()
    for number in (0, 8):
        shutil.copy(unmoved, folder / "frames" / f"{number:03}.png")
    scattered_mm = beads_mm + np.random.default_rng(1).normal(0, 0.8, beads_mm.shape)
    torn = ("001.png", "002.png", "004.png", "005.png")
    for name in torn:
        assert cv2.imwrite(str(folder / "frames" / name), drawn_dome.picture(scattered_mm, seed=7))
    beside_mm = beads_mm.copy()
    beside_mm[40:46] = (beads_mm[40:46] + beads_mm[41:47]) / 2  # six beads half way to their neighbours
    assert cv2.imwrite(str(folder / "frames" / "010.png"), drawn_dome.picture(beside_mm, seed=8))
    calibration = calibrate_paper(folder)
    dropped = {group.reason: (group.count, group.frames) for group in calibration.source.dropped}
    assert dropped == {
        NOT_ONE_SKIN: (4, torn[:3]),
        DOUBTFUL: (1, ("010.png",)),
        NOT_MOVED: (2, ("000.png", "008.png")),
    }
    touches = [press for press in read_dataset(folder).split("train") if press.position_mm]
    assert calibration.source.presses == len(touches) - 7
    ran = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(tmp_path / "d.cal"), "--no-model"])
    assert ran.exit_code == 0
    assert f"left out 4 train frames: {NOT_ONE_SKIN}: 001.png, 002.png, 004.png, ..." in ran.output
    assert f"left out 2 train frames: {NOT_MOVED}: 000.png, 008.png" in ran.output
    assert load_calibration(tmp_path / "d.cal").source.dropped == calibration.source.dropped
