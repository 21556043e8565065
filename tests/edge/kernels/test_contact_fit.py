"""The Gauss-Newton step of the contact fit, by slopes that are differences of the field itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import null_space

from palpate_edge.kernels.contact_fit import ContactFitKernel, FitExpansion, FitSettings
from palpate_edge.kernels.padding import padded_rows

BEADS, DIRECTIONS, CENTRES, SHAPES = 21, 13, 30, 9
SETTINGS = FitSettings(0.01, 0.02, 0.1, 1e-6, 1e-6, 0.35, 0.7, 2.0, 2.0, 0.3)
AZIMUTH_RAD = 0.8
PRECISION = np.array([40.0, 40.0, 10.0, 10.0, 4.0])
FOUND = 19


class Fit:
    """A kernel with random fields and one random frame, and the same field in double precision."""

    def __init__(self, steps, precision=PRECISION):
        random = np.random.default_rng(4)
        self.centres = random.standard_normal((CENTRES, 7)).astype(np.float32)
        self.weights = random.standard_normal((CENTRES, SHAPES)).astype(np.float32)
        self.offset = random.standard_normal(SHAPES).astype(np.float32)
        self.shapes = random.standard_normal((SHAPES + 1, 2 * DIRECTIONS)).astype(np.float32)
        self.skin = (0.3 * random.standard_normal((SHAPES + 1, 3, DIRECTIONS))).astype(np.float32)
        self.px_per_mm = random.standard_normal((BEADS, 2, 3)).astype(np.float32)
        self.covariance = random.uniform(0, 1, (DIRECTIONS, BEADS)).astype(np.float32)
        expansion = FitExpansion(self.centres, self.weights, self.offset, self.shapes, self.skin)
        padded = padded_rows(self.covariance)
        self.kernel = ContactFitKernel(steps, SETTINGS, expansion, self.px_per_mm, padded)
        self.place, self.force_N = np.array([0.48, -0.6, 0.64]), np.array([0.3, 0.8, -1.1])
        self.values, self.size_mm = random.standard_normal(2 * DIRECTIONS), 1.7
        self.weight = random.uniform(0.2, 1.0, BEADS)
        self.weight[3] = 0.0
        cos, sin = math.cos(AZIMUTH_RAD), math.sin(AZIMUTH_RAD)
        self.turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        place, way = self.canonical()
        self.measured_px = self.shown_px(place, way, math.log(self.size_mm))
        self.measured_px += 0.5 * random.standard_normal((BEADS, 2))
        sizes = self.size_mm, math.log(self.size_mm), FOUND
        self.kernel.start[:] = *self.place, *self.force_N, cos, sin, *sizes, *precision
        self.kernel.values[:], self.kernel.bead_weight[:] = self.values, self.weight
        self.kernel.measured_px[:] = self.measured_px

    def canonical(self):
        way = self.force_N / np.linalg.norm(self.force_N)
        return self.turn.T @ self.place, self.turn.T @ way

    def coefficients(self, place, way, log_size):
        point = np.array([*(2 * place), *(2 * (place + way)), 0.3 * log_size])
        near = np.exp(-0.5 * ((self.centres - point) ** 2).sum(axis=1))
        return np.append(near @ self.weights + self.offset, 1.0)

    def shown_px(self, place, way, log_size):
        skin = np.einsum("s,scg->gc", self.coefficients(place, way, log_size), self.skin)
        moved_mm = self.covariance.T @ (math.exp(log_size) * skin) @ self.turn.T
        return np.einsum("nac,nc->na", self.px_per_mm.astype(np.float64), moved_mm)

    def misfit(self, place, way, log_size):
        field = self.coefficients(place, way, log_size) @ self.shapes
        away = field / np.linalg.norm(field) - self.values / np.linalg.norm(self.values)
        return away @ away


def unit(vector):
    return vector / np.linalg.norm(vector)


def one_step(fit):
    """Place, way and logarithm of the size after one step in the canonical frame."""
    (place, way), log_size = fit.canonical(), math.log(fit.size_mm)
    along, across = null_space(place[None]), null_space(way[None])

    def moved(numbers):
        there = place + along @ numbers[:2]
        return there, way + place - there + across @ numbers[2:4], log_size + numbers[4]

    step = 1e-5 * np.eye(5)
    slopes = [(fit.shown_px(*moved(one)) - fit.shown_px(*moved(-one))).ravel() / 2e-5 for one in step]
    slope, left_px = np.stack(slopes, axis=1), (fit.measured_px - fit.shown_px(place, way, log_size)).ravel()
    square = 0.5 * (fit.measured_px**2).sum(axis=1) @ fit.weight / fit.weight.sum()
    signal = max(square - SETTINGS.noise_px2 * FOUND / fit.weight.sum(), SETTINGS.least_signal * square)
    weight = np.repeat(fit.weight / (SETTINGS.noise_px2 + SETTINGS.model_error2 * signal * fit.weight), 2)
    normal = slope.T @ (weight[:, None] * slope) + np.diag(fit.kernel.start[-5:])
    numbers = np.linalg.solve(normal, slope.T @ (weight * left_px))
    numbers *= min(1.0, SETTINGS.largest_turn_rad / np.linalg.norm(numbers[:4]))
    numbers[4] = np.clip(numbers[4], -SETTINGS.largest_growth, SETTINGS.largest_growth)
    there, _, size = moved(numbers)
    return unit(there), unit(way + place - unit(there) + across @ numbers[2:4]), size


@pytest.mark.parametrize("precision", [PRECISION, 1e-3 * PRECISION], ids=["held", "limited"])
def test_a_step_solves_the_weighted_normal_equations(precision):
    fit = Fit(1, precision)
    place, way, log_size = one_step(fit)
    *direction, misfit = fit.kernel.fit()
    assert np.linalg.norm(place - fit.canonical()[0]) > 1e-2
    assert direction == pytest.approx(fit.turn @ place, abs=1e-5)
    assert misfit == pytest.approx(fit.misfit(place, way, log_size), abs=1e-4)


def test_no_step_leaves_the_start():
    fit = Fit(0)
    *direction, misfit = fit.kernel.fit()
    assert direction == pytest.approx(fit.place, abs=1e-12)
    assert misfit == pytest.approx(fit.misfit(*fit.canonical(), math.log(fit.size_mm)), abs=1e-5)


def test_many_steps_come_to_rest():
    few, many = Fit(40).kernel.fit(), Fit(41).kernel.fit()
    assert many == pytest.approx(few, abs=1e-4)


@settings(deadline=None, max_examples=50)
@given(st.data())
def test_any_number_is_computed_with(data):
    fit = Fit(2)
    odd = st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 1e300, -1e30])
    for array in (fit.kernel.start, fit.kernel.values, fit.kernel.measured_px, fit.kernel.bead_weight):
        place = data.draw(st.integers(0, array.size - 1))
        array.ravel()[place] = data.draw(odd)
    assert len(fit.kernel.fit()) == 4


def test_fields_that_do_not_fit_the_beads_are_refused():
    fit = Fit(1)
    expansion = FitExpansion(fit.centres, fit.weights, fit.offset, fit.shapes, fit.skin[:, :, 1:])
    with pytest.raises(ValueError, match="do not fit"):
        ContactFitKernel(1, SETTINGS, expansion, fit.px_per_mm, padded_rows(fit.covariance))
