"""Kernel ridge: the kernel, the prediction, and what it learns where the truth is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from palpate_edge.calibration.training.dome_model import DomeModel, load_dome_model
from palpate_edge.calibration.training.gaussian_kernel import gaussian_kernel
from palpate_edge.calibration.training.kernel_ridge import FEWEST_PRESSES, fit

RADIUS_MM = 30.0


def some(samples, count):
    """The first `count` presses."""
    names = ("fields", "directions", "forces_N", "hidden", "faintness", "press", "plain")
    return replace(samples, **{name: getattr(samples, name)[:count] for name in names})


def dome_of(samples):
    return DomeModel(samples.fields, samples.directions, samples.forces_N, 26.5)


@pytest.fixture(scope="module")
def test_presses(problem):
    return problem.samples(2000, seed=2)


def errors(regression, samples):
    """Position errors (s,) mm and force errors (s,) N."""
    direction, force, _ = regression.predict(samples.fields, samples.hidden)
    return (
        RADIUS_MM * np.linalg.norm(direction - samples.directions, axis=1),
        np.linalg.norm(force - samples.forces_N, axis=1),
    )


def test_the_kernel_is_gaussian():
    rng = np.random.default_rng(1)
    a, b = rng.standard_normal((40, 7)), rng.standard_normal((30, 7))
    by_scipy = np.exp(-cdist(a, b, "sqeuclidean") / (2 * 0.8**2))
    assert gaussian_kernel(a, b, 0.8) == pytest.approx(by_scipy, rel=1e-10)
    assert gaussian_kernel(a, a, 1.7) == pytest.approx(
        np.exp(-cdist(a, a, "sqeuclidean") / (2 * 1.7**2)), rel=1e-10
    )


def test_forces_that_the_dome_model_already_knows_leave_no_error_to_choose_by(problem):
    """Fields of size 1 along one axis each divide without rounding: every setting's error of force is 0."""
    samples = problem.samples(60, seed=1)
    fields = np.eye(samples.fields.shape[1])[np.arange(len(samples.fields)) % 20]
    unknown = replace(samples, fields=fields, forces_N=np.zeros_like(samples.forces_N))
    regression = fit(unknown, dome_of(problem.samples(200, seed=5)), RADIUS_MM)
    direction, force, radius_mm = regression.predict(fields, samples.hidden)
    assert np.isfinite(direction).all() and np.isfinite(force).all() and np.isfinite(radius_mm).all()


def test_a_prediction_is_the_formula(problem):
    """One press at a time, one centre at a time."""
    regression = fit(problem.samples(60, seed=1, most_hidden=0.3), None, RADIUS_MM)
    seen = problem.samples(10, seed=3, most_hidden=0.3)
    direction, force, radius_mm = regression.predict(seen.fields, seen.hidden)
    for row, (field, hidden) in enumerate(zip(seen.fields, seen.hidden, strict=True)):
        size = math.sqrt(sum(value**2 for value in field))
        shape = [value / size - mean for value, mean in zip(field, regression.projection.mean, strict=True)]
        parts = [*np.dot(shape, regression.projection.components), math.log(size)]
        parts[-1] -= regression.projection.log_size
        point = np.dot(parts, regression.projection.metric)
        total = regression.offset.copy()
        for centre, weights in zip(regression.centres, regression.weights, strict=True):
            total += math.exp(-(math.dist(point, centre) ** 2) / (2 * regression.length**2)) * weights
        assert direction[row] == pytest.approx(total[:3] / math.hypot(*total[:3]), abs=1e-9)
        assert force[row] == pytest.approx(size * total[3:6], abs=1e-9)
        assert radius_mm[row] == pytest.approx(math.exp(total[6] + regression.hidden_slope * hidden))


def test_it_learns_a_smooth_map(problem, test_presses):
    quiet = replace(problem, noise_mm=0.0)
    position_mm, force_N = errors(
        fit(quiet.samples(200, seed=1), None, RADIUS_MM), quiet.samples(500, seed=2)
    )
    assert position_mm.mean() < 0.15
    assert np.sqrt((force_N**2).mean()) < 0.01


def test_more_presses_are_better(problem, test_presses):
    samples = problem.samples(400, seed=1)
    few, many = (errors(fit(some(samples, n), None, RADIUS_MM), test_presses)[0].mean() for n in (25, 400))
    assert many < 0.5 * few


def test_the_dome_model_helps_few_presses_and_gives_their_scale(problem, test_presses):
    """The dome model is the same kind of dome, half as stiff as the sensor."""
    dome = dome_of(problem.samples(500, seed=9, stiffness=0.5))
    own = problem.samples(12, seed=1)
    alone, both = fit(own, None, RADIUS_MM), fit(own, dome, RADIUS_MM)
    assert both.stiffness_scale == pytest.approx(2.0, rel=0.02)
    for before, after in zip(errors(alone, test_presses), errors(both, test_presses), strict=True):
        assert after.mean() < 0.3 * before.mean()


def test_without_presses_there_is_the_dome_and_no_scale(problem, test_presses):
    dome = dome_of(problem.samples(500, seed=9))
    regression = fit(None, dome, RADIUS_MM)
    assert regression.stiffness_scale is None
    assert errors(regression, test_presses)[0].mean() < 1.0


def test_fewer_presses_than_can_be_learned_from_only_scale(problem, test_presses):
    dome = dome_of(problem.samples(500, seed=9, stiffness=0.5))
    samples = problem.samples(FEWEST_PRESSES, seed=1)
    nothing = fit(None, dome, RADIUS_MM)
    too_few, enough = (fit(some(samples, n), dome, RADIUS_MM) for n in (FEWEST_PRESSES - 1, FEWEST_PRESSES))
    assert too_few.stiffness_scale == pytest.approx(2.0, rel=0.05)
    dome_alone = nothing.predict(test_presses.fields, test_presses.hidden)
    direction, force, radius_mm = too_few.predict(test_presses.fields, test_presses.hidden)
    assert direction == pytest.approx(dome_alone[0], abs=2e-3)  # own shapes turn the components
    assert radius_mm == pytest.approx(dome_alone[2])
    assert force == pytest.approx(too_few.stiffness_scale * dome_alone[1], abs=1e-2)
    assert len(enough.centres) == len(too_few.centres) + FEWEST_PRESSES


def test_progress_ends_at_its_total(problem):
    steps = []
    fit(problem.samples(20, seed=1), None, RADIUS_MM, lambda *step: steps.append(step))
    done, totals = zip(*steps, strict=True)
    assert list(done) == list(range(1, totals[0] + 1))
    assert len(set(totals)) == 1


@pytest.mark.parametrize("with_dome", [False, True])
def test_places_are_learned_as_well_without_forces(problem, test_presses, with_dome):
    samples = problem.samples(80, seed=1)
    dome = dome_of(problem.samples(200, seed=4)) if with_dome else None
    known = fit(samples, dome, RADIUS_MM)
    unknown = fit(replace(samples, forces_N=np.zeros_like(samples.forces_N)), dome, RADIUS_MM)
    assert unknown.stiffness_scale is None
    with_forces_mm, without_forces_mm = (errors(model, test_presses)[0].mean() for model in (known, unknown))
    assert without_forces_mm < 1.3 * with_forces_mm
    assert np.isfinite(unknown.misfit(test_presses.fields)).all()


def test_the_force_of_faint_presses_of_the_dome_model_changes_that_of_firm_ones_little():
    dome = load_dome_model()
    size = np.linalg.norm(dome.fields, axis=1)
    faint, firm = size < 0.1 * np.median(size), size > np.median(size)
    assert faint.sum() > 100
    wild = replace(dome, forces=np.where(faint[:, None], 5.0 * dome.forces, dome.forces))
    given, changed = (
        fit(None, one, 30.0).predict(dome.fields[firm], np.zeros(firm.sum()))[1] for one in (dome, wild)
    )
    off = np.linalg.norm(changed - given, axis=1) / np.linalg.norm(given, axis=1)
    assert np.percentile(off, 95) < 0.1  # 0.18 where all presses count alike


def test_presses_of_the_dome_model_with_hidden_beads_count_less(problem, test_presses):
    dome = dome_of(problem.samples(500, seed=9))
    plain = np.arange(len(dome.fields)) % 2 == 0
    given = fit(None, replace(dome, plain=plain), RADIUS_MM).predict(test_presses.fields, test_presses.hidden)
    changed_N = []
    for wrong in (plain, ~plain):
        noise = 0.05 * np.random.default_rng(0).standard_normal(dome.forces.shape)
        noisy = replace(dome, plain=plain, forces=dome.forces + np.where(wrong[:, None], noise, 0.0))
        forces_N = fit(None, noisy, RADIUS_MM).predict(test_presses.fields, test_presses.hidden)[1]
        changed_N.append(np.linalg.norm(forces_N - given[1], axis=1).mean())
    assert changed_N[1] < 0.7 * changed_N[0], changed_N
