"""The camera's roll and magnification, which a learned layout leaves open, from presses of known place."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.measurement import measure
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.calibration.training.learned_camera import (
    MAGNIFICATION_SIGMA,
    camera_magnification,
    camera_roll,
    magnified,
    turned,
    with_camera_of_presses,
)
from palpate_edge.calibration.training.samples import training_presses
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.geometry.angles import rotation_about_z

ROLL_RAD = 0.03
FACTOR = 0.96  # of the magnification
PRESSES = 30


@pytest.fixture(scope="module")
def sample(shared_data):
    """The press sample's first presses; its layout is known, and so is the camera's roll."""
    dataset = read_dataset(shared_data("press-sample"))
    touches = [press for press in dataset.split("train") if press.position_mm is not None]
    return replace(dataset, presses=tuple(touches[:PRESSES]))


@pytest.fixture(scope="module")
def measured(sample):
    return measure(sample, sample.presses)


def found_roll(sample, measured):
    radius_mm = sample.sensor.markers.radius_mm
    reader = DisplacementReader(measured.reference.position_px, measured.view, radius_mm)
    return camera_roll(reader, training_presses(measured), load_dome_model().for_markers(radius_mm)).angle_rad


def test_a_camera_whose_layout_is_known_has_none(sample, measured):
    assert abs(found_roll(sample, measured)) < 0.005


@pytest.mark.slow
def test_a_camera_turned_by_hand_is_turned_back(sample, measured):
    """Thirty presses weigh five times as much as assembly's tolerance: a sixth of the roll is left."""
    wrong = turned(measured, sample.sensor, rotation_about_z(-ROLL_RAD))
    assert found_roll(sample, wrong) == pytest.approx(5 / 6 * ROLL_RAD, abs=0.002)


def test_turning_changes_no_picture(sample, measured):
    before = measured.view.project(measured.registration.layout_mm)
    after = turned(measured, sample.sensor, rotation_about_z(ROLL_RAD))
    np.testing.assert_allclose(after.view.project(after.registration.layout_mm), before, atol=1e-9)


def found_magnification(sample, measured):
    dome = load_dome_model().for_markers(sample.sensor.markers.radius_mm)
    return camera_magnification(measured, sample.sensor, training_presses(measured), dome)


def test_a_camera_whose_layout_is_known_has_its_magnification(sample, measured):
    found = found_magnification(sample, measured)
    assert found.factor == pytest.approx(1, abs=0.015)  # the dome model's error is 0.01
    assert found.sigma < 0.6 * MAGNIFICATION_SIGMA


@pytest.mark.slow
def test_a_camera_of_a_wrong_focal_length_is_mended(sample, measured):
    """The places of a known layout's beads are the truth."""
    layout_mm = measured.registration.layout_mm
    wrong = magnified(measured, sample.sensor, FACTOR)
    mended, _ = with_camera_of_presses(wrong, sample.sensor, load_dome_model())
    was_mm, is_mm = (
        np.linalg.norm(each.registration.layout_mm - layout_mm, axis=1).mean() for each in (wrong, mended)
    )
    assert was_mm > 0.5, was_mm
    assert is_mm < 0.4 * was_mm, (was_mm, is_mm)


def test_another_magnification_changes_no_picture(sample, measured):
    before = measured.view.project(measured.registration.layout_mm)
    after = magnified(measured, sample.sensor, FACTOR)
    np.testing.assert_allclose(after.view.project(after.registration.layout_mm), before, atol=1e-6)
    on_sphere = np.linalg.norm(after.registration.layout_mm, axis=1)
    np.testing.assert_allclose(on_sphere, sample.sensor.markers.radius_mm)


def test_no_press_leaves_the_magnification_open(sample, measured):
    same, open_rad = with_camera_of_presses(replace(measured, touches=()), sample.sensor, load_dome_model())
    assert same.registration.pose.focal_scale == measured.registration.pose.focal_scale
    assert open_rad > MAGNIFICATION_SIGMA


def test_no_press_tells_no_roll(sample, measured):
    assert found_roll(sample, replace(measured, touches=())) == 0.0


@pytest.mark.slow
def test_a_calibration_with_a_learned_layout_has_the_roll_of_its_presses(sample):
    """The probe's frame is turned against the camera: without rings only the presses know it."""
    turn = rotation_about_z(ROLL_RAD)
    presses = tuple(
        replace(
            press,
            position_mm=tuple((turn @ press.position_mm).tolist()),
            force_N=tuple((turn @ press.force_N).tolist()),
        )
        for press in sample.presses
    )
    markers = msgspec.structs.replace(sample.sensor.markers, rings=())
    sensor = msgspec.structs.replace(sample.sensor, markers=markers)
    found = calibrate(replace(sample, sensor=sensor, presses=presses), dome=load_dome_model())
    assert found.pose.rotation_rad[2] == pytest.approx(ROLL_RAD, abs=0.005)
