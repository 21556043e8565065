"""Closed forms for symmetric 3 x 3 matrices against numpy's general ones."""

import numpy as np
import pytest

from palpate_host.common import symmetric


def parts(S):
    """The six numbers of a symmetric matrix, as the closed forms take them."""
    (a, b, c), (_, d, e), (_, _, f) = S.tolist()
    return a, b, c, d, e, f


def random_mobility(seed):
    """J B^-1 J^T of a random finger with three joints."""
    J = np.random.default_rng(seed).normal(size=(3, 3))
    return J @ J.T


@pytest.mark.parametrize("seed", range(20))
def test_inverse_determinant_and_largest_eigenvalue_are_numpys(seed):
    S = random_mobility(seed)
    np.testing.assert_allclose(symmetric.inverse(*parts(S)), np.linalg.inv(S), rtol=1e-8)
    assert symmetric.determinant(*parts(S)) == pytest.approx(np.linalg.det(S), rel=1e-9)
    assert symmetric.largest_eigenvalue(*parts(S)) == pytest.approx(np.linalg.eigvalsh(S)[-1], rel=1e-9)


@pytest.mark.parametrize("S", [3.0 * np.eye(3), np.zeros((3, 3)), np.diag([1.0, 1.0, 5.0]), np.ones((3, 3))])
def test_the_largest_eigenvalue_where_some_are_equal(S):
    assert symmetric.largest_eigenvalue(*parts(S)) == pytest.approx(np.linalg.eigvalsh(S)[-1], abs=1e-7)


def test_a_singular_matrix_has_no_inverse():
    with pytest.raises(ZeroDivisionError):
        symmetric.inverse(*parts(np.diag([1.0, 2.0, 0.0])))
