"""The corrected method in the estimator: which method is taken, what it gives, which models are refused."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration, save_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator, best_method
from palpate_edge.estimation.frame_estimator import Method

PRESS = (0.5, 0.8, 1.8)  # theta_rad, phi_rad, depth_mm


@pytest.fixture(scope="module")
def with_model(drawn_dataset):
    """The drawn sensor with the correction model, from its train presses and the shipped dome."""
    return calibrate(read_dataset(drawn_dataset), dome=load_dome_model())


@pytest.fixture(scope="module")
def frame_of(drawn_dome):
    """Draw a frame: ``frame_of((theta, phi, depth), hidden=(...))``."""

    def draw(press, hidden=()):
        image = drawn_dome.picture(drawn_dome.pressed_mm(*press), 77, tuple(hidden))
        return Frame(image, 1000, 1, "1")

    return draw


def refusal(calibration, method=None):
    with pytest.raises(CalibrationError) as error:
        Estimator(calibration, method)
    text = str(error.value)
    assert "\n" not in text
    return text


def test_the_best_method_is_the_corrected_one_where_there_is_a_model(with_model, drawn_calibration):
    assert best_method(with_model) is Method.CORRECTED
    assert best_method(drawn_calibration) is Method.PAPER
    assert Estimator(with_model).method is Method.CORRECTED
    assert Estimator(drawn_calibration).method is Method.PAPER


def test_the_papers_method_does_not_care_for_the_model(with_model, drawn_calibration, frame_of):
    frame = frame_of(PRESS)
    plain = Estimator(drawn_calibration).estimate(frame)
    assert Estimator(with_model, Method.PAPER).estimate(frame) == plain
    assert plain.radius95_mm is None


def test_the_corrected_method_gives_place_force_and_radius(with_model, frame_of):
    contact = Estimator(with_model).estimate(frame_of(PRESS))
    assert contact.valid, contact.reason
    theta, phi, depth = PRESS
    truth = 30 * np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
    error_mm = math.dist(contact.position_mm, truth)
    assert error_mm < 1.0
    assert error_mm <= contact.radius95_mm < 5
    assert math.hypot(*contact.position_mm) == pytest.approx(30)
    assert contact.force_N == pytest.approx(-0.8 * depth * truth / 30, abs=0.1)  # conftest: 0.8 N/mm
    inward = -np.dot(contact.force_N, contact.position_mm) / 30
    assert contact.normal_force_N == pytest.approx(inward)


def test_presses_not_trained_on_are_placed_better_than_by_the_paper(with_model, drawn_dataset):
    """The drawn dent is another body than the dome model's: its own 41 presses teach the difference."""
    dataset, errors_mm = read_dataset(drawn_dataset), {}
    for method in Method:
        estimator, errors_mm[method] = Estimator(with_model, method), []
        for press in dataset.split("test"):
            image = read_image(dataset.path(press))
            contact = estimator.estimate(Frame(image, 0, 0, press.frame))
            if press.position_mm is not None:
                errors_mm[method].append(math.dist(press.position_mm, contact.position_mm))
    assert len(errors_mm[Method.PAPER]) >= 10
    assert np.mean(errors_mm[Method.CORRECTED]) < 0.5
    assert np.mean(errors_mm[Method.CORRECTED]) < 0.3 * np.mean(errors_mm[Method.PAPER])


def test_hidden_beads_widen_the_radius(with_model, frame_of):
    hidden = np.random.default_rng(2).permutation(85)[:25].tolist()
    whole, partly = (Estimator(with_model).estimate(frame_of(PRESS, gone)) for gone in ((), hidden))
    assert partly.valid, partly.reason
    assert partly.beads_found == 60
    assert partly.radius95_mm > whole.radius95_mm
    assert math.dist(partly.position_mm, whole.position_mm) <= partly.radius95_mm


def test_a_hidden_region_costs_only_contacts_that_could_be_in_it(with_model, frame_of):
    """Opposite the press: the press is still measured, but without one a contact could be hidden there."""
    places = with_model.reference().position_px
    theta, phi, _ = PRESS
    opposite = places.mean(axis=0) - 110.0 * np.array([math.cos(phi), math.sin(phi)])
    region = np.argsort(np.linalg.norm(places - opposite, axis=1))[:20].tolist()
    pressed = Estimator(with_model).estimate(frame_of(PRESS, region))
    assert pressed.in_contact, pressed.reason
    truth = 30 * np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])
    assert math.dist(pressed.position_mm, truth) <= pressed.radius95_mm
    untouched = Estimator(with_model).estimate(frame_of((0.0, 0.0, 0.0), region))
    assert untouched.reason == "all beads of a region are hidden: a contact there could not be detected"


def test_nothing_touching_is_no_force_and_no_place(with_model, frame_of):
    contact = Estimator(with_model).estimate(frame_of((0.0, 0.0, 0.0)))
    assert contact.valid
    assert not contact.in_contact
    assert (contact.position_mm, contact.normal_force_N, contact.radius95_mm) == (None, 0.0, None)


def test_a_missing_model_is_refused(drawn_calibration):
    text = refusal(drawn_calibration, Method.CORRECTED)
    assert "holds no correction model" in text
    assert "method paper" in text


def test_a_damaged_model_is_refused(with_model):
    model = with_model.model
    for spoilt in (model[:-100], model[: len(model) // 2], b"no model"):
        assert "palpate-edge calibrate" in refusal(msgspec.structs.replace(with_model, model=spoilt))


def test_the_model_of_another_sensor_is_refused(with_model):
    ours = with_model.sensor
    thinner = msgspec.structs.replace(ours, dome=msgspec.structs.replace(ours.dome, wall_mm=4.0))
    text = refusal(msgspec.structs.replace(with_model, sensor=thinner))
    assert ours.fingerprint() in text
    assert thinner.fingerprint() in text


def test_a_changed_digit_of_the_model_is_found_by_the_files_checksum(with_model, tmp_path):
    path = tmp_path / "a.cal"
    save_calibration(with_model, path)
    assert load_calibration(path).model == with_model.model
    whole = path.read_bytes()
    begin = whole.index(b'"model": "') + len(b'"model": "')
    for share in (0.1, 0.5, 0.9):  # of the model's text, base64
        at = begin + int(share * len(with_model.model))
        other = b"A" if whole[at : at + 1] != b"A" else b"B"
        path.write_bytes(whole[:at] + other + whole[at + 1 :])
        with pytest.raises(CalibrationError, match="make it again with palpate-edge calibrate"):
            load_calibration(path)


def test_without_onnxruntime_the_way_out_is_told(with_model, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)  # Python's own way to make an import fail
    text = refusal(with_model)
    assert "pip install 'palpate[onnx]'" in text
    assert Estimator(with_model, Method.PAPER).method is Method.PAPER


THREADS = """
import os, sys
from pathlib import Path
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.estimation.estimator import Estimator
calibration = load_calibration(Path(sys.argv[1]))
before = len(os.listdir("/proc/self/task"))
Estimator(calibration)
print(len(os.listdir("/proc/self/task")) - before)
"""


def test_the_model_starts_no_thread_that_reports_to_others(with_model, tmp_path):
    """onnxruntime's Linux wheels have such a thread by default, except where `CI` is set."""
    save_calibration(with_model, tmp_path / "finger.cal")
    kept = {name: value for name, value in os.environ.items() if name not in ("CI", "ORT_DISABLE_TELEMETRY")}
    done = subprocess.run(
        [sys.executable, "-c", THREADS, tmp_path / "finger.cal"],
        env={**kept, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "0\n"


def test_one_calibration_gives_one_model(drawn_dataset, with_model):
    again = calibrate(read_dataset(drawn_dataset), dome=load_dome_model())
    assert again.model == with_model.model
