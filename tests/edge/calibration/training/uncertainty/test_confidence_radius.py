"""The 95 % radius: leaving presses out is exact, and the radius covers what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.inverse_factor import inverse_factor
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.uncertainty.confidence_radius import (
    STRANGER_DEG,
    UNTAUGHT,
    constant_radius,
    fit_radius,
    left_out_residuals,
    strangeness,
)
from palpate_edge.estimation.skin_motion import faintness

RADIUS_MM = 30.0


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), sizes=st.lists(st.integers(1, 6), min_size=2, max_size=8))
def test_left_out_residuals_are_those_of_refits(seed, sizes):
    rng = np.random.default_rng(seed)
    count = sum(sizes)
    points, target = rng.standard_normal((count, 4)), rng.standard_normal((count, 3))
    gram = np.exp(-0.5 * ((points[:, None] - points[None]) ** 2).sum(axis=2))
    ridge = rng.uniform(0.01, 1)
    owner = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    factor = inverse_factor(gram + ridge * np.eye(count))
    groups = [np.flatnonzero(owner == number) for number in range(len(sizes))]
    found = left_out_residuals(factor, factor.T @ factor @ target, groups)
    for number in range(len(sizes)):
        out, rest = owner == number, owner != number
        known = gram[np.ix_(rest, rest)] + ridge * np.eye(int(rest.sum()))
        refit = gram[np.ix_(out, rest)] @ np.linalg.solve(known, target[rest])
        assert found[out] == pytest.approx(target[out] - refit, abs=1e-7)


def covered(problem, regression, samples):
    direction, _, radius_mm = regression.predict(samples.fields, samples.hidden)
    error_mm = RADIUS_MM * np.linalg.norm(direction - samples.directions, axis=1)
    return error_mm <= radius_mm, radius_mm, error_mm


@pytest.mark.long
def test_the_radius_covers_95_percent(problem):
    """800 presses to fit, 4000 others to count: the count itself is off by 0.35 % (one sigma)."""
    regression = fit(problem.samples(800, seed=1), None, RADIUS_MM)
    inside, radius_mm, error_mm = covered(problem, regression, problem.samples(4000, seed=2))
    assert 0.93 <= inside.mean() <= 0.97
    firm = np.argsort(radius_mm)
    certain, doubtful = firm[:1000], firm[-1000:]
    assert error_mm[doubtful].mean() > 2 * error_mm[certain].mean()  # it knows which presses are bad


@pytest.mark.parametrize("presses", [10, 20, 40])
def test_few_presses_do_not_promise_too_much(problem, presses):
    """On average over twenty sensors; a quantile from few presses cannot be exact, but must not be short."""
    shares = []
    for seed in range(20):
        regression = fit(problem.samples(presses, seed=10 + seed), None, RADIUS_MM)
        inside, _, _ = covered(problem, regression, problem.samples(500, seed=2))
        shares.append(inside.mean())
    assert np.mean(shares) >= 0.90, np.mean(shares)


@pytest.mark.long
def test_the_radius_grows_with_hidden_beads(problem):
    """The noise of the problem grows three times from none hidden to a quarter; so does the radius."""
    regression = fit(problem.samples(800, seed=1, most_hidden=0.3), None, RADIUS_MM)
    fields = problem.samples(500, seed=2).fields
    _, _, none_mm = regression.predict(fields, np.zeros(500))
    _, _, quarter_mm = regression.predict(fields, np.full(500, 0.25))
    assert 1.8 < np.median(quarter_mm / none_mm) < 5
    inside, _, _ = covered(problem, regression, problem.samples(2000, seed=3, most_hidden=0.3))
    assert 0.90 <= inside.mean() <= 0.99


def test_a_touch_at_the_threshold_may_be_anywhere_and_a_firm_one_is_as_sure_as_the_model():
    """Errors of a wrong bead grow as one over the motion: half the motion, twice the error."""
    assert faintness(1.0, 0.02) == pytest.approx(np.hypot(1, 36 * 0.02 / 0.98))
    assert faintness(0.02, 0.02) > 1000
    assert faintness(20.0, 0.02) == pytest.approx(1, abs=1e-3)
    assert faintness(0.22, 0.02) / faintness(0.42, 0.02) == pytest.approx(2, rel=0.1)


def test_faint_presses_do_not_widen_the_radius_of_firm_ones(problem):
    """Every second press ten times as far off, and known to be: the firm ones' radius stays what it was."""
    samples = problem.samples(100, seed=1)
    faint = np.where(np.arange(100) % 2, 10.0, 1.0)
    error_mm = np.abs(np.random.default_rng(3).standard_normal(100)) * 0.2
    groups = [np.array([press]) for press in range(100)]
    gram = np.exp(-(np.linalg.norm(samples.directions[:, None] - samples.directions[None], axis=2) ** 2))
    firm = fit_radius(gram, error_mm, samples, groups, RADIUS_MM)
    mixed = fit_radius(gram, error_mm * faint, replace(samples, faintness=faint), groups, RADIUS_MM)
    assert mixed.level == pytest.approx(firm.level)
    blind = fit_radius(gram, error_mm * faint, samples, groups, RADIUS_MM)
    assert blind.level > firm.level + 0.5


def at_polar_angles(theta_deg, azimuth_rad=0.0):
    theta = np.radians(theta_deg)
    around = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)]) * np.ones((len(theta), 2))
    return np.column_stack([np.sin(theta)[:, None] * around, np.cos(theta)])


@pytest.mark.parametrize("roll_sigma_rad", [0.0, 0.01, 0.02])
@pytest.mark.parametrize("stretch_sigma", [0.0, 0.02])
def test_the_radius_without_presses_covers_what_a_learned_layout_leaves_open(roll_sigma_rad, stretch_sigma):
    """Contacts all over the dome up to 75 deg, each of another sensor: the roll moves a contact along its
    parallel, the magnification along its meridian."""
    rng, count = np.random.default_rng(0), 20_000
    polar_rad = np.arccos(rng.uniform(np.cos(np.radians(75.0)), 1.0, count))
    normal = rng.standard_normal((4, count))
    of_model = UNTAUGHT / np.sqrt(-2 * np.log(0.05)) * normal[:2]  # 95 % within UNTAUGHT
    along = roll_sigma_rad * normal[2] * np.sin(polar_rad) + of_model[0]
    across = stretch_sigma * normal[3] * polar_rad + of_model[1]
    radius = constant_radius(RADIUS_MM, float(np.hypot(roll_sigma_rad, stretch_sigma)))
    covered = RADIUS_MM * np.hypot(along, across) <= np.exp(radius.level)
    assert 0.93 <= covered.mean() <= 0.97


def test_a_contact_is_as_strange_as_its_polar_angle_is_far_from_the_known_ones():
    """Whatever the azimuth: a dome is the same all around."""
    known = at_polar_angles(np.array([20.0, 50.0]))
    asked = at_polar_angles(np.array([50.0, 56.0, 35.0, 0.0]), azimuth_rad=2.0)
    gap_deg = np.array([0.0, 6.0, 15.0, 20.0])
    assert strangeness(asked, known) == pytest.approx(1 + gap_deg / STRANGER_DEG, abs=1e-6)


def between(samples, low_deg, high_deg):
    """The presses of these polar angles, numbered anew."""
    theta_deg = np.degrees(np.arccos(samples.directions[:, 2]))
    some = np.flatnonzero((theta_deg >= low_deg) & (theta_deg < high_deg))
    names = ("fields", "directions", "forces_N", "hidden", "faintness", "plain")
    taken = {name: getattr(samples, name)[some] for name in names}
    return replace(samples, **taken, press=np.arange(len(some)))


def test_the_radius_grows_where_no_press_was(problem):
    """A sensor pressed nearer to the rim than 45 deg, whose dome model knows the apex too."""
    known = problem.samples(600, seed=4)
    dome = DomeModel(known.fields, known.directions, known.forces_N, 26.5)
    regression = fit(between(problem.samples(120, seed=1), 45, 90), dome, RADIUS_MM)
    asked = problem.samples(1000, seed=2)
    radii = [
        np.median(regression.predict(part.fields, part.hidden)[2])
        for part in (between(asked, 45, 90), between(asked, 0, 30))
    ]
    assert radii[1] > 1.5 * radii[0]
