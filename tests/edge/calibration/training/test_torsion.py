"""Torsion and the intervals of torsion and force, on a problem whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.quantity_figures import force_covered_percent, quantity_lines, torsion_figures
from palpate_edge.calibration.training.dome_model import DomeModel, TwistedPresses
from palpate_edge.calibration.training.kernel_ridge import Regression, fit
from palpate_edge.calibration.training.onnx_export import export
from palpate_edge.calibration.training.samples import Samples
from palpate_edge.calibration.training.uncertainty.interval import fit_interval
from palpate_edge.common.contact import Contact
from palpate_edge.datasets.press_dataset import Press
from palpate_edge.estimation.correction_model import CorrectionModel
from palpate_edge.estimation.displacement_field import CanonicalField

RADIUS_MM = 30.0


def twisted(problem, count: int, seed: int) -> Samples:
    """Presses whose fields also have a pattern in proportion to the torsion, over a lever of the place."""
    plain = problem.samples(count, seed)
    rng = np.random.default_rng([seed, 1])
    pattern = np.cos(1.7 * problem.phase)
    lever = 2.0 + plain.directions[:, 2]
    torsions = rng.uniform(-4, 4, count)
    fields = plain.fields + (torsions / lever)[:, None] * 0.4 * pattern
    return replace(plain, fields=fields, torsions_Nmm=torsions)


@pytest.fixture(scope="module")
def taught(problem) -> tuple[Regression, Samples]:
    return fit(twisted(problem, 170, 1), None, RADIUS_MM), twisted(problem, 300, 2)


def test_torsions_of_new_presses_are_near_the_truth_and_in_their_intervals(taught):
    regression, seen = taught
    error = np.abs(regression.torsions_Nmm(seen.fields) - seen.torsions_Nmm)
    assert np.sqrt((error**2).mean()) < 0.05 * 8
    held = error <= regression.torsion95.half_width(seen.fields, seen.hidden)
    assert 0.9 <= held.mean() <= 0.99
    _, force_N, _ = regression.predict(seen.fields, seen.hidden)
    miss_N = np.linalg.norm(force_N - seen.forces_N, axis=1)
    assert 0.9 <= (miss_N <= regression.force95.half_width(seen.fields, seen.hidden)).mean() <= 0.99


def test_presses_of_a_softer_dome_help_where_own_ones_are_few(problem):
    """The dome model is of a third of the stiffness, so that its forces and torsions are three times less."""
    known, own, seen = (twisted(problem, *drawn) for drawn in ((300, 3), (12, 4), (300, 2)))
    presses = TwistedPresses(known.fields, known.torsions_Nmm / 3)
    dome = DomeModel(known.fields, known.directions, known.forces_N / 3, 26.5, presses)
    rms_Nmm = [
        np.sqrt(((fit(own, start, RADIUS_MM).torsions_Nmm(seen.fields) - seen.torsions_Nmm) ** 2).mean())
        for start in (dome, replace(dome, twisted=None))
    ]
    assert rms_Nmm[0] < 0.5 * rms_Nmm[1]


def test_torsions_of_a_dome_that_is_unlike_do_no_harm(problem):
    own, seen = twisted(problem, 60, 4), twisted(problem, 300, 2)
    wrong = np.random.default_rng(1).uniform(-4, 4, 300)
    known = twisted(problem, 300, 3)
    dome = DomeModel(
        known.fields, known.directions, known.forces_N, 26.5, TwistedPresses(known.fields, wrong)
    )
    rms_Nmm = [
        np.sqrt(((fit(own, start, RADIUS_MM).torsions_Nmm(seen.fields) - seen.torsions_Nmm) ** 2).mean())
        for start in (dome, replace(dome, twisted=None))
    ]
    assert rms_Nmm[0] < 1.1 * rms_Nmm[1]


@pytest.mark.parametrize(("presses", "most"), [(8, 1.0), (200, 0.98)])
def test_intervals_hold_from_few_presses_as_from_many(presses, most):
    """Normal errors that grow with the root of the field's size, each press with its mirror image; 60 draws.

    From few presses intervals are wide, since settings are chosen by the same presses; here they are not.
    """
    rng = np.random.default_rng(7)

    def drawn(count):
        size_mm = np.exp(rng.normal(0.0, 0.6, count))
        return size_mm, np.abs(rng.standard_normal(count)) * np.sqrt(size_mm)

    held = []
    for _ in range(60):
        size_mm, error = (np.repeat(values, 2) for values in drawn(presses))
        samples = Samples(
            fields=size_mm[:, None],
            directions=np.zeros((2 * presses, 3)),
            forces_N=np.zeros((2 * presses, 3)),
            hidden=np.zeros(2 * presses),
            faintness=np.ones(2 * presses),
            press=np.repeat(np.arange(presses), 2),
            plain=np.ones(2 * presses, dtype=np.bool_),
        )
        size_mm, error_then = drawn(500)
        interval = fit_interval(error, samples)
        held.append((error_then <= interval.half_width(size_mm[:, None], np.zeros(500))).mean())
    assert 0.94 <= np.mean(held) <= most
    assert np.percentile(held, 10) > 0.9


def test_the_file_gives_them_and_a_file_without_them_gives_none(taught, problem):
    regression, seen = taught
    model = CorrectionModel(export(regression, "sensor", seen.fields), "sensor")
    correction = model.correct(CanonicalField(seen.fields[0], 0.3, 0.1))
    width = regression.torsion95.half_width(seen.fields[:1], np.array([0.1]))[0]
    assert correction.torsion_Nmm == pytest.approx(regression.torsions_Nmm(seen.fields[:1])[0], abs=0.01)
    assert correction.torsion95_Nmm == pytest.approx(width, rel=1e-3)
    assert correction.force95_N is not None
    untaught = fit(problem.samples(40, 1), None, RADIUS_MM)
    assert untaught.torsions_Nmm(seen.fields) is None
    former = replace(untaught, force95=None)  # a file of the version before has neither
    for file, gives_force in ((untaught, True), (former, False)):
        correction = CorrectionModel(export(file, "sensor", seen.fields), "sensor").correct(
            CanonicalField(seen.fields[0], 0.3, 0.1)
        )
        assert (correction.torsion_Nmm, correction.torsion95_Nmm) == (None, None)
        assert (correction.force95_N is not None) == gives_force


def press(torsion_Nmm: float | None) -> Press:
    return Press("a.jpg", "test", 0.0, (0.0, 0.0, 30.0), 1.0, (0.0, 0.0, -1.0), "plate", 0, torsion_Nmm)


def contact(torsion_Nmm: float | None, force95_N: float | None = None) -> Contact:
    return Contact(
        1, 2, True, True, (0.0, 0.0, 30.0), 1.0, (0.0, 0.3, -1.0), 1.0, "", 85, 85,
        torsion_Nmm=torsion_Nmm, torsion95_Nmm=None if torsion_Nmm is None else 0.5, force95_N=force95_N,
    )  # fmt: skip


def test_figures_are_those_computed_by_hand():
    """Errors of 1 and 0 N mm in a range of 4: 0.707, 17.68 %; one of two within 0.5. A force 0.3 N off."""
    pairs = [(press(-1.0), contact(0.0, 0.31)), (press(3.0), contact(3.0, 0.29)), (press(None), contact(9.0))]
    figures = torsion_figures(pairs)
    assert (figures.count, figures.range_Nmm, figures.covered_percent) == (2, 4.0, 50.0)
    assert figures.rmse_percent == pytest.approx(100 * np.sqrt(0.5) / 4)
    assert force_covered_percent(pairs) == 50.0
    assert quantity_lines(figures, 50.0) == [
        "force: 50.0 % within its 95 % radius",
        "torsion: RMSE 0.707 N mm, 17.68 % of its range of 4.00 N mm, 50.0 % in the 95 % interval",
    ]
    assert torsion_figures([(press(1.0), contact(None))]) is None
    assert quantity_lines(None, None) == []
