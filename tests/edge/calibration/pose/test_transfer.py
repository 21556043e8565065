"""A pad calibrated from a pose model of another pad: with no press of its own, with a few, and refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from tests.edge.calibration.pose.drawn_pad import DrawnPad

from palpate_edge.calibration.pose.label_axes import declared_change, measured_change
from palpate_edge.calibration.pose.pose_evaluation import evaluate_pose
from palpate_edge.calibration.pose.pose_model import PoseModel, load_pose_model, save_pose_model
from palpate_edge.calibration.pose.rest_registration import register_rest
from palpate_edge.calibration.pose.transfer import calibrate_with_model
from palpate_edge.calibration.pose.untouched_rest import untouched_offset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.cli.main import cli
from palpate_edge.common.arrays import Array
from palpate_edge.common.contact_quantities import POSE_LABELS
from palpate_edge.common.errors import CalibrationError
from palpate_edge.datasets.pose_dataset import read_pose_dataset
from palpate_edge.geometry.picture_sensor import LabelAxes

SPAN = (2.0, 6.0, 6.0, 4.0, 4.0, 12.0)
# The other pad's table: x axis to the image's bottom, motion of the sensor.
AXES = '[labels]\nx_axis_deg = 90\nmotion_of = "sensor"\n'


@dataclass(frozen=True)
class TurnedPad(DrawnPad):
    """A pad whose table has other axes: x of the table is y of the image, y is -x, motions are reversed."""

    def pressed_px(self, pose: Array) -> Array:
        depth, tilt_x, tilt_y, shear_x, shear_y, torsion = pose
        return super().pressed_px(np.array([depth, -tilt_y, tilt_x, shear_y, -shear_x, -torsion]))


OTHER = TurnedPad(pitch_px=18.0, diameter_px=8.0)


@pytest.fixture(scope="module")
def model_file(pad_dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "pad.npz"
    run = CliRunner().invoke(cli, ["train", str(pad_dataset), "-o", str(path)])
    assert run.exit_code == 0, run.output
    assert "120 presses of 1 sensors with 61 beads" in run.output
    return path


def errors(model_file: Path, folder: Path, tmp_path: Path) -> list[float]:
    """Mean absolute error of each label over a guess's, on the test split."""
    path = tmp_path / "other.cal"
    run = CliRunner().invoke(
        cli, ["calibrate", str(folder), "-o", str(path), "--dome-model", str(model_file)]
    )
    assert run.exit_code == 0, run.output
    calibration = calibrate_with_model(read_pose_dataset(folder), load_pose_model(model_file))
    figures = evaluate_pose(folder, "test", calibration, path)
    assert not figures.refused
    return [label.mean_all / (span / 4) for label, span in zip(figures.labels, SPAN, strict=True)]


@pytest.mark.slow
def test_declared_axes_without_presses_and_measured_ones_with_presses(model_file, tmp_path):
    bare = OTHER.write(tmp_path / "bare", 4, 12, markers=AXES)  # too few presses to learn from
    assert max(errors(model_file, bare, tmp_path)) < 0.4
    assert max(errors(model_file, OTHER.write(tmp_path / "few", 20, 12), tmp_path)) < 0.4


@pytest.mark.slow
def test_a_model_of_another_kind_is_refused(model_file, tmp_path):
    larger = replace(OTHER, rings=5)
    dataset = read_pose_dataset(larger.write(tmp_path / "larger", 0, 1))
    with pytest.raises(CalibrationError, match="sensors with 61 markers, this one has 91"):
        calibrate_with_model(dataset, load_pose_model(model_file))
    dome = tmp_path / "dome.npz"
    np.savez(dome, fields=np.zeros(3))
    for bad, folder, words in (
        (dome, larger.write(tmp_path / "again", 0, 1), "is not a pose model"),
        (tmp_path / "none.npz", tmp_path / "again", "none.npz"),
    ):
        run = CliRunner().invoke(
            cli, ["calibrate", str(folder), "-o", str(tmp_path / "c.cal"), "--dome-model", str(bad)]
        )
        assert run.exit_code != 0
        assert words in f"{run.output} {run.exception}"


def test_a_model_file_is_what_was_saved(tmp_path):
    random = np.random.default_rng(1)
    model = PoseModel(
        random.uniform(0, 100, (7, 2)),
        random.normal(size=(5, 14)),
        ("depth_mm", "torsion_deg"),
        random.normal(size=(5, 2)),
        LabelAxes(30.0, "sensor"),
    )
    save_pose_model(model, tmp_path / "m.npz")
    back = load_pose_model(tmp_path / "m.npz")
    assert back.labels == model.labels
    assert back.axes == model.axes
    np.testing.assert_array_equal(back.rest_px, model.rest_px)
    np.testing.assert_allclose(back.displacement_px, model.displacement_px, rtol=1e-3)
    with pytest.raises(CalibrationError, match="is a pose model, a press dataset needs a dome model"):
        load_dome_model(tmp_path / "m.npz")
    whole = (tmp_path / "m.npz").read_bytes()
    for bad in (b"", b"PK", whole[:-30], whole[:200], whole.replace(b"targets", b"torgets")):
        (tmp_path / "bad.npz").write_bytes(bad)
        with pytest.raises(CalibrationError, match=r"bad\.npz"):
            load_pose_model(tmp_path / "bad.npz")
    save_pose_model(replace(model, displacement_px=model.displacement_px[:, :12]), tmp_path / "m.npz")
    with pytest.raises(CalibrationError, match="do not belong together"):
        load_pose_model(tmp_path / "m.npz")


def test_axes_declared_and_measured_are_the_same_change():
    random = np.random.default_rng(2)
    source = random.normal(size=(10, 6))
    change = declared_change(LabelAxes(0.0, "object"), LabelAxes(90.0, "sensor"))
    expected = source[:, [0, 2, 1, 4, 3, 5]] * [1, 1, -1, -1, 1, -1]  # x' = y, y' = -x, motions reversed
    np.testing.assert_allclose(change.applied(source, POSE_LABELS), expected, atol=1e-12)
    measured = measured_change(source, expected, POSE_LABELS)
    assert measured is not None
    assert measured.sign == -1
    assert measured.turn_rad == pytest.approx(-np.pi / 2)


def test_a_layout_that_is_scaled_shifted_and_warped_is_registered_marker_by_marker():
    own = DrawnPad().rest_px()
    shuffled = np.random.default_rng(3).permutation(len(own))
    centred = (own - own.mean(axis=0)) / 80
    other = (1.3 * centred + 0.05 * centred**3 + [2.0, -1.0])[shuffled]
    registration = register_rest(own, other)
    np.testing.assert_array_equal(shuffled[registration.order], np.arange(len(own)))
    np.testing.assert_allclose(registration.map(other)[registration.order], own, atol=0.2)
    square = np.stack(np.meshgrid(np.arange(8.0), np.arange(8.0)), axis=-1).reshape(-1, 2)[:61]
    with pytest.raises(CalibrationError, match="markers at rest differ"):
        register_rest(own, square)


def test_the_untouched_rest_of_a_sensor_whose_reference_is_a_press():
    pad, labels = DrawnPad(), POSE_LABELS
    poses = pad.poses(400, seed=5)
    poses[:, 0] -= 0.8
    reference = pad.pressed_px(np.array([0.6, 3.0, -3.0, 2.0, 1.0, 5.0]))
    moved = np.array([(pad.pressed_px(pose) - reference).ravel() for pose in poses])
    offset = untouched_offset(reference, moved, poses, labels).reshape(-1, 2)
    before = np.abs(pad.rest_px() - reference).mean()
    assert np.abs(pad.rest_px() - reference - offset).mean() < 0.4 * before
    few, deep = slice(60), poses[:, 0] > 1
    assert not untouched_offset(reference, moved[few], poses[few], labels).any()
    assert not untouched_offset(reference, moved[deep], poses[deep], labels).any()
