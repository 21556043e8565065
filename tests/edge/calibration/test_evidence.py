"""Means by evidence against Bayes' rule worked by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from palpate_edge.calibration.evidence import mean_by_evidence


def test_each_setting_counts_by_its_evidence():
    """Evidences 1 : 3, so shares of a quarter and three quarters."""
    found = [(np.array([0.0, 4.0]), np.array(8.0)), (np.array([4.0, 0.0]), np.array(0.0))]
    (first, second), log_sum = mean_by_evidence([math.log(2.0), math.log(6.0)], found)
    assert first == pytest.approx([3.0, 1.0])
    assert float(second) == pytest.approx(2.0)
    assert log_sum == pytest.approx(math.log(8.0))


def test_logarithms_far_outside_the_range_of_numbers():
    (mean,), log_sum = mean_by_evidence([-5000.0, -5000.0], [(np.array(1.0),), (np.array(3.0),)])
    assert float(mean) == pytest.approx(2.0)
    assert log_sum == pytest.approx(-5000.0 + math.log(2.0))
