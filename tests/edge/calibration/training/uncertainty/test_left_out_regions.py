"""Errors of presses left out in turn, against presses that were really left out, and counted by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.training.dome_model import DomeModel
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.uncertainty.left_out_regions import region_errors
from palpate_edge.estimation.calibration import RegionErrors


def test_regions_count_each_press_once(problem):
    """Presses at 10, 40, 50, 80 and 90 deg above the base, each with its mirror image and a turned copy."""
    above = np.radians([10, 40, 50, 80, 90])
    directions = np.stack([np.cos(above), np.zeros(5), np.sin(above)], axis=1)
    one = problem.samples(15, seed=0)
    press = np.repeat(np.arange(5), 3)
    samples = replace(one, directions=directions[press], press=press, plain=np.tile([True, True, False], 5))
    error_mm = np.tile([0.0, 9.0, 9.0], 5) + np.repeat([1.0, 2.0, 3.0, 4.0, 5.0], 3)
    held = np.repeat([True, True, False, True, False], 3)
    assert region_errors(samples, error_mm, held) == (
        RegionErrors(0, 30, 1, 1.0, 1.0, 1),
        RegionErrors(30, 45, 1, 2.0, 2.0, 1),
        RegionErrors(45, 60, 1, 3.0, 3.0, 0),
        RegionErrors(60, 75, 0),
        RegionErrors(75, 90, 2, 4.5, 5.0, 1),
    )


def test_they_are_the_errors_of_other_presses(problem):
    """The mean error of left-out presses is that of new presses of the same sensor."""
    others = problem.samples(150, seed=1)
    dome = DomeModel(others.fields, others.directions, others.forces_N, 26.5)
    regression = fit(problem.samples(60, seed=4), dome, 30.0)
    told = regression.regions
    assert sum(region.presses for region in told) == 60
    unseen = problem.samples(300, seed=5)
    direction, _, _ = regression.predict(unseen.fields, np.zeros(300))
    error_mm = 30.0 * np.linalg.norm(direction - unseen.directions, axis=1)
    left_out_mm = sum(region.presses * region.mean_mm for region in told) / 60
    assert left_out_mm == pytest.approx(
        error_mm.mean(), rel=0.4
    )  # of 60 errors, each about as large as its mean
    assert sum(region.held for region in told) >= 50
    assert fit(None, dome, 30.0).regions == ()
