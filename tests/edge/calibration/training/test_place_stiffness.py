"""Stiffness by place: walls of known stiffness, and each press left out by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.training import place_stiffness
from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.left_out import LeftOut
from palpate_edge.calibration.training.place_stiffness import evened, fit_place_stiffness, refit_evenly
from palpate_edge.calibration.training.samples import Samples, TrainingPress
from palpate_edge.calibration.training.uncertainty.confidence_radius import constant_radius
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.contact_fit.place_stiffness import StiffnessMap
from palpate_edge.vision.beads import Beads

NO_BEADS = Beads.from_positions(np.zeros((0, 2)), np.zeros(0, dtype=np.bool_))
RADIUS = constant_radius(30.0, 0.0)  # of no effect


def directions(count: int, seed: int) -> Array:
    random = np.random.default_rng(seed)
    theta, phi = np.arccos(random.uniform(0.4, 1, count)), random.uniform(-np.pi, np.pi, count)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)


def left_out(
    ratio: Array, seed: int, noise: float = 0.02, slant: Array | float = 0.0
) -> tuple[LeftOut, list[TrainingPress]]:
    """Presses whose true forces are `ratio` (c,) times the model's, but for noise, and `slant` (c, 3) times
    their size beside it.

    Canonical frames are turned about z by any angle, and each press has its mirror image.
    """
    random = np.random.default_rng(seed)
    count = len(ratio)
    places = directions(count, seed)
    fields = random.uniform(0.2, 2.0, (count, 1)) * np.ones((count, 4))
    forces_N = -random.uniform(0.2, 3.0, (count, 1)) * places + 0.1 * random.standard_normal((count, 3))
    given_N = forces_N / (ratio * np.exp(noise * random.standard_normal(count)))[:, None]
    forces_N = forces_N + np.linalg.norm(forces_N, axis=1, keepdims=True) * slant
    angle = random.uniform(-np.pi, np.pi, count)
    cos, sin = np.cos(angle), np.sin(angle)

    def canonical(vectors: Array) -> Array:
        x, y, z = vectors.T
        turned = np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)
        return np.concatenate([turned, turned * (1.0, -1.0, 1.0)])

    samples = Samples(
        fields=np.concatenate([fields, fields]),
        directions=canonical(places),
        forces_N=canonical(forces_N),
        hidden=np.zeros(2 * count),
        faintness=np.ones(2 * count),
        press=np.tile(np.arange(count), 2),
        plain=np.ones(2 * count, dtype=np.bool_),
    )
    presses = [TrainingPress(NO_BEADS, place, force) for place, force in zip(places, forces_N, strict=True)]
    return LeftOut(samples, samples.directions, canonical(given_N), RADIUS), presses


def stiffer_to_one_side(at: Array) -> Array:
    return np.exp(0.15 * at[:, 0])


@pytest.mark.parametrize(("count", "worst"), [(20, 0.05), (150, 0.02)])
def test_a_wall_that_is_stiffer_to_one_side_is_learned(count, worst):
    found = fit_place_stiffness(*left_out(stiffer_to_one_side(directions(count, 3)), 3))
    assert found is not None
    stiffness, elsewhere = StiffnessMap(found.stiffness), directions(50, 4)
    ratio = [stiffness.ratio(tuple(map(float, place))) for place in elsewhere]
    off = np.log(ratio) - np.log(stiffer_to_one_side(elsewhere))
    assert np.sqrt((off**2).mean()) < worst


def test_an_even_wall_stays_even():
    """Noise of 5 % in each of 40 presses: the stiffness is off by less than 2 % (root mean square)."""
    elsewhere = directions(50, 4)
    for seed in range(16):
        found = fit_place_stiffness(*left_out(np.ones(40), seed, noise=0.05))
        if found is not None:
            stiffness = StiffnessMap(found.stiffness)
            off = np.log([stiffness.ratio(tuple(map(float, place))) for place in elsewhere])
            assert np.sqrt((off**2).mean()) < 0.02


def test_the_half_width_of_forces_is_of_the_forces_with_it():
    ratio = stiffer_to_one_side(directions(150, 5))
    with_it = fit_place_stiffness(*left_out(ratio, 5))
    noise_alone = fit_place_stiffness(*left_out(np.full(150, 1.05), 5))
    assert with_it is not None and noise_alone is not None
    assert with_it.force95 is not None and noise_alone.force95 is not None
    field, hidden = np.ones((1, 4)), np.zeros(1)
    assert with_it.force95.half_width(field, hidden) == pytest.approx(
        noise_alone.force95.half_width(field, hidden), rel=0.25
    )


def test_what_is_left_of_a_press_is_what_a_fit_without_it_leaves(monkeypatch):
    """One setting, so that the shares of the settings stay; each press left out by hand."""
    monkeypatch.setattr(place_stiffness, "AMPLITUDES", (0.1,))
    monkeypatch.setattr(place_stiffness, "NOISES", (0.05,))
    random = np.random.default_rng(2)
    places, noise = directions(12, 2), random.uniform(1, 3, 12)
    values = [0.1 * random.standard_normal((12, columns)) for columns in (1, 3)]
    smooth = gaussian_kernel(places, places, 0.6)
    posteriors = place_stiffness._posteriors(0.6, smooth, values, noise)
    for press in range(12):
        rest = np.arange(12) != press
        others = [each[rest] for each in values]
        without = place_stiffness._posteriors(0.6, smooth[np.ix_(rest, rest)], others, noise[rest])
        for each, posterior, fewer in zip(values, posteriors, without, strict=True):
            expected = smooth[press, rest] @ fewer.weights + fewer.offset
            np.testing.assert_allclose(posterior.left_over[press], each[press] - expected, atol=1e-12)


def test_forces_that_the_model_gives_rightly_are_left_alone():
    right, presses = left_out(np.ones(30), 6, noise=0.0)
    assert fit_place_stiffness(right, presses) is None


def pushed_aside(at: Array) -> Array:
    """Slants (n, 3) of a wall that pushes presses from +x to -x, the more the nearer they are to +y."""
    to_side = np.array([-1.0, 0.0, 0.0]) * (0.1 + 0.1 * at[:, 1:2])
    return np.asarray(to_side - np.vecdot(to_side, at)[:, None] * at)


def test_slants_are_learned():
    places, elsewhere = directions(150, 3), directions(50, 4)
    found = fit_place_stiffness(*left_out(stiffer_to_one_side(places), 3, slant=pushed_aside(places)))
    assert found is not None
    wall = StiffnessMap(found.stiffness)
    given = np.array([wall.slant(tuple(map(float, place))) for place in elsewhere])
    assert np.vecdot(given, elsewhere) == pytest.approx(0.0, abs=1e-6)
    off = given - pushed_aside(elsewhere)
    assert np.sqrt((off**2).sum(axis=1).mean()) < 0.02


def test_a_wall_without_slants_has_none():
    found = fit_place_stiffness(*left_out(stiffer_to_one_side(directions(150, 3)), 3))
    assert found is not None
    assert StiffnessMap(found.stiffness).slant((0.6, 0.0, 0.8)) == (0.0, 0.0, 0.0)


def test_evened_forces_become_the_true_ones_on_the_wall_that_was_learned():
    """But for the square of the slant, 0.04 at most."""
    places = directions(150, 3)
    out, presses = left_out(stiffer_to_one_side(places), 3, slant=pushed_aside(places))
    found = fit_place_stiffness(out, presses)
    assert found is not None
    wall = StiffnessMap(found.stiffness)
    for press, even in zip(presses, evened(presses, found.stiffness), strict=True):
        place, force_N = tuple(map(float, press.direction)), np.asarray(press.force_N)
        again_N = np.array(wall.corrected(place, tuple(map(float, even.force_N))))
        assert np.linalg.norm(again_N - force_N) < 0.04 * np.linalg.norm(force_N)
        assert np.linalg.norm(even.force_N - force_N) > 0


def canonical(problem, count: int, seed: int) -> tuple[Samples, Array]:
    """Presses of the conftest's problem turned to azimuth 0, and their places."""
    found = problem.samples(count, seed)
    places, depth_mm = found.directions, np.linalg.norm(found.forces_N, axis=1, keepdims=True)
    turned = np.stack([np.hypot(places[:, 0], places[:, 1]), np.zeros(count), places[:, 2]], axis=1)
    fields = depth_mm * np.sin(turned @ problem.waves + problem.phase)
    return replace(found, directions=turned, fields=fields, forces_N=-depth_mm * turned), places


class UnevenSensor:
    """A sensor whose forces are `ratio` of the place times those of an even wall."""

    def __init__(self, problem, ratio, *, with_dome: bool) -> None:
        self.samples, places = canonical(problem, 150, 7)
        self.dome = None
        if with_dome:
            dome, _ = canonical(problem, 60, 8)
            self.dome = DomeModel(dome.fields, dome.directions, dome.forces_N, 30.0)
        size_N = np.linalg.norm(self.samples.forces_N, axis=1) * ratio(places)
        self.presses = [
            TrainingPress(NO_BEADS, *one) for one in zip(places, -size_N[:, None] * places, strict=True)
        ]

    def fit(self, presses):
        """The model of presses, whose canonical forces are turned back to azimuth 0."""
        size_N = np.array([np.linalg.norm(press.force_N) for press in presses])[:, None]
        return fit(replace(self.samples, forces_N=-size_N * self.samples.directions), self.dome, 30.0)

    def even_error_N(self, model) -> float:
        _, given_N, _ = model.predict(self.samples.fields, self.samples.hidden)
        return float(np.linalg.norm(given_N - self.samples.forces_N, axis=1).mean())


@pytest.mark.parametrize("with_dome", [False, True])
def test_on_an_uneven_wall_the_model_is_fitted_again_to_an_even_one(problem, with_dome):
    sensor = UnevenSensor(problem, lambda at: np.exp(0.3 * at[:, 0]), with_dome=with_dome)
    once = sensor.fit(sensor.presses)
    alone = fit_place_stiffness(once.left_out, sensor.presses)
    model, stiffness = refit_evenly(once, sensor.presses, sensor.fit)
    assert model is not once and alone is not None and stiffness is not None
    assert stiffness.miss_N < alone.miss_N and stiffness.gain > alone.gain
    assert sensor.even_error_N(model) < 0.8 * sensor.even_error_N(once)


def test_the_dome_model_shows_a_wall_that_the_sensors_own_model_hides(problem, monkeypatch):
    """As if the sensor's own presses left no stiffness over."""
    sensor = UnevenSensor(problem, lambda at: np.exp(0.3 * at[:, 0]), with_dome=True)
    once = sensor.fit(sensor.presses)
    hides = place_stiffness.fit_place_stiffness
    monkeypatch.setattr(
        place_stiffness,
        "fit_place_stiffness",
        lambda out, presses: None if out is once.left_out else hides(out, presses),
    )
    model, stiffness = refit_evenly(once, sensor.presses, sensor.fit)
    assert model is not once and stiffness is not None


def test_on_an_even_wall_the_model_stays(problem):
    sensor = UnevenSensor(problem, lambda at: np.ones(len(at)), with_dome=True)
    once = sensor.fit(sensor.presses)
    model, _ = refit_evenly(once, sensor.presses, sensor.fit)
    assert model is once


def test_presses_without_forces_show_no_stiffness(problem):
    sensor = UnevenSensor(problem, lambda at: np.exp(0.3 * at[:, 0]), with_dome=False)
    once = sensor.fit(sensor.presses)
    unknown = [replace(press, force_N=None) for press in sensor.presses]
    assert refit_evenly(once, unknown, sensor.fit) == (once, None)
