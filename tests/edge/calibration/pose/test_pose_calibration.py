"""Calibrating, estimating and evaluating a drawn pad: known by its pictures, labels are poses."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.pose.calibrate_pose import calibrate_pose
from palpate_edge.calibration.pose.pose_calibration_file import load_pose_calibration
from palpate_edge.calibration.pose.rest_markers import find_rest_markers
from palpate_edge.cli.main import cli
from palpate_edge.common.contact_quantities import POSE_LABELS
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.pose_dataset import read_pose_dataset
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.network import NetworkLayer, Networks
from palpate_edge.estimation.pose.pose_estimator import PoseEstimator

pytestmark = pytest.mark.long

SPAN = dict(zip(POSE_LABELS, (2.0, 6.0, 6.0, 4.0, 4.0, 12.0), strict=True))


def test_markers_at_rest_are_those_that_were_drawn(pad, pad_calibration):
    drawn, found = pad.rest_px(), pad_calibration.rest_px()
    assert len(found) == pad.count == 61
    apart = np.linalg.norm(drawn[:, None] - found[None], axis=2)
    assert apart.min(axis=1).max() < 0.3
    assert pad_calibration.diameter_px == pytest.approx(pad.diameter_px, rel=0.2)


def test_every_pose_of_the_test_split_is_estimated(pad_dataset, pad_calibration_file):
    run = CliRunner().invoke(
        cli, ["evaluate", str(pad_dataset), "--calibration", str(pad_calibration_file), "--json", "-"]
    )
    assert run.exit_code == 0, run.output
    figures = json.loads(run.stdout)
    assert figures["frames"] == 40
    assert figures["refused"] == {}
    assert [label["label"] for label in figures["labels"]] == list(POSE_LABELS)
    for label in figures["labels"]:
        assert label["mean"] == label["mean_all"] < 0.08 * SPAN[label["label"]]  # a third of a guess
        assert label["covered_percent"] >= 80  # of 40: at 95 %, fewer by chance is one in a thousand


def test_csv_has_estimates_and_half_widths_in_columns_of_their_own(
    pad_dataset, pad_calibration_file, tmp_path
):
    out = tmp_path / "out.csv"
    run = CliRunner().invoke(
        cli,
        ["estimate", str(pad_dataset), "--calibration", str(pad_calibration_file), "--csv", str(out)],
    )
    assert run.exit_code == 0, run.output
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 160
    assert all(row["x_mm"] == row["fn_N"] == row["fx_N"] == row["radius95_mm"] == "" for row in rows)
    assert all(row["contact"] == "1" and float(row["quality"]) > 0.9 for row in rows)
    assert all(float(row[f"{label}_95"]) > 0 for row in rows for label in POSE_LABELS)


def test_a_rest_frame_touches_nothing(pad, pad_calibration):
    image = pad.picture(pad.rest_px(), seed=1234)
    contact = PoseEstimator(pad_calibration).estimate(Frame(image, 0, 0, "rest"))
    assert contact.valid
    assert not contact.in_contact
    assert contact.position_mm is None
    assert contact.normal_force_N is None


def test_a_frame_without_the_markers_is_refused(pad, pad_calibration):
    estimator = PoseEstimator(pad_calibration)
    noise = np.random.default_rng(1).integers(0, 255, (240, 240), dtype=np.uint8)
    half = pad.picture(pad.rest_px()[: pad.count // 2], seed=5)
    frames = [np.zeros((240, 240), np.uint8), noise, half, np.zeros((10, 10), np.uint8)]
    contacts = [estimator.estimate(Frame(image, 0, n, "")) for n, image in enumerate(frames)]
    assert not any(contact.valid for contact in contacts)
    assert "of 61 beads found" in contacts[2].reason
    assert "frame is 10x10" in contacts[3].reason


def test_only_the_labels_of_the_table_are_learned(pad, tmp_path):
    folder = pad.write(tmp_path / "two", 40, 4, ("depth_mm", "torsion_deg"))
    calibration = calibrate_pose(read_pose_dataset(folder))
    assert calibration.labels == ("depth_mm", "torsion_deg")


def test_a_declared_layout_and_a_mask_leave_out_what_is_no_marker(pad, tmp_path):
    folder = pad.write(tmp_path / "lamp", 40, 2, markers='layout = "hexagonal"\ncount = 61\n')
    for path in [*(folder / "reference").iterdir(), *(folder / "frames").iterdir()]:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        for x in (15, 35, 205, 225):  # reflections as large as markers, where none are
            cv2.circle(image, (x, 12), 4, 230, -1)
        assert cv2.imwrite(str(path), image)
    mask = np.zeros((240, 240), np.uint8)
    mask[28:] = 255
    assert cv2.imwrite(str(folder / "mask.png"), mask)
    calibration = calibrate_pose(read_pose_dataset(folder))
    assert len(calibration.beads) == 61
    assert min(y for _, y in calibration.beads) > 28


def test_a_reflection_beside_a_hexagon_does_not_replace_a_hidden_marker(pad, tmp_path):
    """A marker is hidden in each reference frame, and a lamp is reflected at a marker's distance."""
    folder = pad.write(tmp_path / "lamp", 0, 0, markers='layout = "hexagonal"\ncount = 61\n')
    rest_px = pad.rest_px()
    x, y = np.rint(rest_px[30] + [5 * pad.pitch_px, 0.0]).astype(int)
    hidden_x, hidden_y = np.rint(rest_px[20]).astype(int)
    for path in (folder / "reference").iterdir():
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        cv2.circle(image, (x, y), 4, 230, -1)
        cv2.circle(image, (hidden_x, hidden_y), 7, 40, -1)
        assert cv2.imwrite(str(path), image)
    position_px = find_rest_markers(read_pose_dataset(folder)).position_px
    apart_px = np.linalg.norm(rest_px[:, None] - position_px[None], axis=2)
    assert sorted(apart_px.argmin(axis=0)) == list(range(61))
    assert apart_px.min(axis=1).max() < 0.1 * pad.pitch_px


def test_markers_that_make_no_hexagon_are_refused(pad, tmp_path):
    folder = pad.write(tmp_path / "other", 20, 0, markers='layout = "hexagonal"\ncount = 91\n')
    with pytest.raises(CalibrationError, match="61 of the 91 markers of a hexagonal layout were found"):
        calibrate_pose(read_pose_dataset(folder))


def test_a_hexagonal_layout_needs_its_count(pad, tmp_path):
    folder = pad.write(tmp_path / "none", 20, 0, markers='layout = "hexagonal"\n')
    with pytest.raises(DatasetError, match=r"markers\.count is missing: it must be one of 7, 19"):
        read_pose_dataset(folder)


def test_a_press_that_cannot_be_read_is_left_out_and_named(pad, pad_dataset, tmp_path):
    folder = shutil.copytree(pad_dataset, tmp_path / "copy")
    torn = pad.picture(pad.rest_px()[::3], seed=3)
    assert cv2.imwrite(str(folder / "frames" / "005.png"), torn)
    run = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(tmp_path / "c.cal")])
    assert run.exit_code == 0, run.output
    assert "119 presses" in run.output
    assert "left out 1 train frames: markers could not be followed: 005.png" in run.output


def test_more_markers_declared_than_there_are_is_refused(pad, tmp_path):
    folder = pad.write(tmp_path / "many", 20, 0, markers="count = 91\n")
    with pytest.raises(CalibrationError, match="61 markers were found, 91 are declared"):
        calibrate_pose(read_pose_dataset(folder))


def test_too_few_presses_are_refused(pad, tmp_path):
    with pytest.raises(CalibrationError, match="has 5 rows of the split train, at least 20"):
        calibrate_pose(read_pose_dataset(pad.write(tmp_path / "few", 5, 0)))


def test_the_file_is_checked(pad_calibration, pad_calibration_file, tmp_path):
    assert load_pose_calibration(pad_calibration_file).digest() == pad_calibration.digest()
    changed = tmp_path / "changed.cal"
    text = pad_calibration_file.read_text()
    changed.write_text(text.replace('"weakest_strength":', '"weakest_strength":1', 1))
    with pytest.raises(CalibrationError, match=r"changed or damaged"):
        load_pose_calibration(changed)
    with pytest.raises(CalibrationError, match="calibrates pose labels, not contacts"):
        load_calibration(pad_calibration_file)


@pytest.mark.parametrize("option", [["--no-model"], ["--picture", "a.png"]])
def test_options_of_a_dome_are_refused(pad_dataset, tmp_path, option):
    run = CliRunner().invoke(cli, ["calibrate", str(pad_dataset), "-o", str(tmp_path / "c.cal"), *option])
    assert run.exit_code != 0
    assert not Path(tmp_path / "c.cal").exists()


@pytest.mark.slow
def test_pose_labels_beside_contact_places_are_learned_when_asked_for(pad_dataset, tmp_path):
    folder = shutil.copytree(pad_dataset, tmp_path / "both")
    head, *rows = (folder / "truth.csv").read_text().splitlines()
    press = "t_s,x_mm,y_mm,z_mm,fn_N,fx_N,fy_N,fz_N,probe,lost"
    both = [f"{row},0,,,,0,0,0,0,none,0" for row in rows]
    (folder / "truth.csv").write_text("\n".join([f"{head},{press}", *both]))
    out = tmp_path / "pose.cal"
    run = CliRunner().invoke(cli, ["calibrate", str(folder), "-o", str(out), "--labels", "pose"])
    assert run.exit_code == 0, run.output
    assert load_pose_calibration(out).labels == POSE_LABELS
    run = CliRunner().invoke(cli, ["calibrate", str(pad_dataset), "-o", str(out), "--labels", "contact"])
    assert "has no contact places" in str(run.exception)


def test_networks_correct_the_labels_that_they_name_and_no_others(pad, pad_calibration):
    """Networks of weight 0 and bias 2, with outputs of size 3, add 6 to torsion."""
    local = [each for each in pad_calibration.local or () if set(each.labels) <= {5}]
    inputs = len(POSE_LABELS) + sum(len(each.labels) for each in local)
    layer = NetworkLayer(packed(np.zeros((1, inputs, 1))), packed(np.full((1, 1, 1), 2.0)))
    ones = packed(np.ones(inputs))
    networks = Networks((5,), ones, ones, (layer,), packed(np.array([3.0])))
    frame = Frame(pad.picture(pad.rest_px(), seed=9), 0, 0, "rest")
    plain, corrected = (
        PoseEstimator(calibration).estimate(frame).pose
        for calibration in (pad_calibration, msgspec.structs.replace(pad_calibration, networks=networks))
    )
    added = [after.value - before.value for before, after in zip(plain, corrected, strict=True)]
    assert added == pytest.approx([0, 0, 0, 0, 0, 6], abs=1e-4)
