"""The model file: it gives what numpy gives, and anything else is refused in one line."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from palpate_edge.calibration.training import onnx_export
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.onnx_export import export
from palpate_edge.common.errors import CalibrationError
from palpate_edge.estimation.correction_model import CorrectionModel
from palpate_edge.estimation.displacement_field import CanonicalField

SENSOR = "0123456789abcdef"
OTHER_SENSOR = "fedcba9876543210"


@pytest.fixture(scope="module")
def seen(problem):
    """Presses that the model was not trained on."""
    return problem.samples(50, seed=2, most_hidden=0.3)


@pytest.fixture(scope="module")
def regression(problem):
    return fit(problem.samples(150, seed=1, most_hidden=0.3), None, 30.0)


@pytest.fixture(scope="module")
def file(regression, seen):
    return export(regression, SENSOR, seen.fields)


@pytest.fixture
def in_float64(regression, seen, monkeypatch):
    """The file of a fit that float32 does not do for."""
    monkeypatch.setattr(onnx_export, "MAX_DIRECTION_ERROR", 1e-9)
    return export(regression, SENSOR, seen.fields)


def check_against_numpy(file, regression, seen, tolerance):
    """tolerance: of a direction's part, of the largest force, of the radius."""
    model = CorrectionModel(file, SENSOR)
    direction, force, radius_mm = regression.predict(seen.fields, seen.hidden)
    force_tolerance_N = tolerance * np.linalg.norm(force, axis=1).max()
    for row in range(len(seen.fields)):
        got = model.correct(CanonicalField(seen.fields[row], 0.0, float(seen.hidden[row])))
        assert got.direction == pytest.approx(direction[row], abs=tolerance)
        assert got.force_N == pytest.approx(force[row], abs=force_tolerance_N)
        assert got.radius95_mm == pytest.approx(radius_mm[row], rel=tolerance)


def test_it_gives_what_numpy_gives(regression, file, seen):
    check_against_numpy(file, regression, seen, 1e-4)


def test_in_float64_it_gives_the_same_to_the_last_digits(regression, in_float64, seen):
    check_against_numpy(in_float64, regression, seen, 1e-8)


def test_misfit_is_the_distance_to_the_field_of_the_answer(file, problem, seen):
    """Squared, between shapes of size 1; the answer's field by the problem's own formula. Fields joined of
    two presses, and noise, are farther from it than any press."""
    model = CorrectionModel(file, SENSOR)

    def shape_of(direction):
        field = np.sin(direction @ problem.waves + problem.phase)
        return field / np.linalg.norm(field)

    found, expected = [], []
    for values in seen.fields:
        correction = model.correct(CanonicalField(values, 0.0, 0.0))
        found.append(correction.misfit)
        off = values / np.linalg.norm(values) - shape_of(correction.direction)
        expected.append((off**2).sum())
    assert np.median(np.abs(np.subtract(found, expected))) < 0.01
    half = seen.fields.shape[1] // 2
    joined = np.concatenate([seen.fields[:-1, :half], seen.fields[1:, half:]], axis=1)
    spliced = [model.correct(CanonicalField(values, 0.0, 0.0)).misfit for values in joined]
    assert np.median(spliced) > np.quantile(found, 0.99)
    noise = np.random.default_rng(4).standard_normal((20, seen.fields.shape[1]))
    assert min(model.correct(CanonicalField(values, 0.0, 0.0)).misfit for values in noise) > max(found)


@pytest.mark.parametrize("azimuth", [-2.5, 0.3, math.pi])
def test_its_answer_is_turned_back_into_the_fingertip_frame(file, seen, azimuth):
    model, turn = CorrectionModel(file, SENSOR), Rotation.from_rotvec([0, 0, azimuth])
    straight = model.correct(CanonicalField(seen.fields[0], 0.0, 0.0))
    turned = model.correct(CanonicalField(seen.fields[0], azimuth, 0.0))
    assert turned.direction == pytest.approx(turn.apply(straight.direction), abs=1e-12)
    assert turned.force_N == pytest.approx(turn.apply(straight.force_N), abs=1e-12)
    assert turned.radius95_mm == straight.radius95_mm
    assert np.linalg.norm(turned.direction) == pytest.approx(1)


def kinds(file):
    return {tensor.data_type for tensor in onnx.load_from_string(file).graph.initializer}


def test_its_numbers_are_float32_where_that_does(file, in_float64):
    assert kinds(file) == {onnx.TensorProto.FLOAT, onnx.TensorProto.INT64}
    assert kinds(in_float64) == {onnx.TensorProto.DOUBLE, onnx.TensorProto.INT64}


def test_a_model_of_another_sensor_is_refused(file, one_line):
    with pytest.raises(CalibrationError) as error:
        CorrectionModel(file, OTHER_SENSOR)
    text = one_line(error)
    assert all(word in text for word in (SENSOR, OTHER_SENSOR, "palpate-edge calibrate"))


@settings(deadline=None, max_examples=40)
@given(data=st.data())
def test_a_shortened_model_is_refused(file, one_line, data):
    end = data.draw(st.integers(0, len(file) - 1))
    with pytest.raises(CalibrationError, match="run palpate-edge calibrate again") as error:
        CorrectionModel(file[:end], SENSOR)
    one_line(error)


@settings(deadline=None, max_examples=40)
@given(noise=st.binary(max_size=200))
def test_random_bytes_are_refused(noise, one_line):
    with pytest.raises(CalibrationError, match="run palpate-edge calibrate again") as error:
        CorrectionModel(noise, SENSOR)
    one_line(error)


def test_a_file_that_differs_from_the_fit_is_not_given_out(regression, seen, one_line, monkeypatch):
    """A graph made from slightly other weights stands for an export that went wrong."""
    graph, other = onnx_export._graph, replace(regression, weights=1.05 * regression.weights)
    monkeypatch.setattr(
        onnx_export, "_graph", lambda _right, sensor, precision: graph(other, sensor, precision)
    )
    with pytest.raises(CalibrationError, match="the exported model differs from the fitted one") as error:
        export(regression, SENSOR, seen.fields)
    one_line(error)
