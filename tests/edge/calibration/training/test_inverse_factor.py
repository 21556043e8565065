"""The factor of an inverse against numpy's inverse."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.training.inverse_factor import inverse_factor


@pytest.mark.parametrize("count", [1, 64, 65, 301])
def test_the_product_is_the_inverse(count):
    some = np.random.default_rng(count).standard_normal((count, count + 5))
    matrix = some @ some.T + np.eye(count)
    factor = inverse_factor(matrix)
    assert np.array_equal(factor, np.tril(factor))
    np.testing.assert_allclose(factor.T @ factor, np.linalg.inv(matrix), rtol=1e-8, atol=1e-12)


def test_a_matrix_that_has_no_factor_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        inverse_factor(np.diag([1.0, -1.0]))
