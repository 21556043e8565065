"""The median of arrays.py against the standard library's."""

from __future__ import annotations

import statistics

import numpy as np
import pytest

from palpate_edge.common.arrays import median


@pytest.mark.parametrize("count", [1, 2, 3, 10, 11])
@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_median_is_that_of_the_standard_library(count, kind):
    values = np.random.default_rng(count).permutation(np.arange(count) ** 2).astype(kind) / 4
    assert median(values) == statistics.median(values.tolist())


def test_median_of_a_table_is_that_of_all_its_numbers():
    assert median(np.array([[4.0, 1.0], [8.0, 2.0]])) == 3.0
