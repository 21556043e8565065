"""Stiffness by place: walls of known stiffness, and each press left out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.training import place_stiffness
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.left_out import LeftOut
from palpate_edge.calibration.training.place_stiffness import fit_place_stiffness
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


def left_out(ratio: Array, seed: int, noise: float = 0.02) -> tuple[LeftOut, list[TrainingPress]]:
    """Presses whose true forces are `ratio` (c,) times the model's, but for noise.

    Canonical frames are turned about z by any angle, and each press has its mirror image.
    """
    random = np.random.default_rng(seed)
    count = len(ratio)
    places = directions(count, seed)
    fields = random.uniform(0.2, 2.0, (count, 1)) * np.ones((count, 4))
    forces_N = -random.uniform(0.2, 3.0, (count, 1)) * places + 0.1 * random.standard_normal((count, 3))
    given_N = forces_N / (ratio * np.exp(noise * random.standard_normal(count)))[:, None]
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
    places, log_ratio, noise = directions(12, 2), 0.1 * random.standard_normal(12), random.uniform(1, 3, 12)
    smooth = gaussian_kernel(places, places, 0.6)
    posterior = place_stiffness._posterior(smooth, log_ratio, noise)
    for press in range(12):
        rest = np.arange(12) != press
        without = place_stiffness._posterior(smooth[np.ix_(rest, rest)], log_ratio[rest], noise[rest])
        expected = smooth[press, rest] @ without.weights + without.offset
        assert posterior.left_over[press] == pytest.approx(log_ratio[press] - expected, abs=1e-12)


def test_forces_that_the_model_gives_rightly_are_left_alone():
    right, presses = left_out(np.ones(30), 6, noise=0.0)
    assert fit_place_stiffness(right, presses) is None
