"""Kernel sums: their values, and files that were written before the kernel was named."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from palpate_edge.estimation.pose.kernel_expansion import Expansion, ExpansionRunner, packed

ONE = packed(np.ones((1, 1)))
CENTRES = np.zeros((1, 1))


@pytest.mark.parametrize(("kernel", "value"), [("gaussian", 0.135335), ("matern", 0.139731)])
def test_an_expansion_is_its_offset_and_its_kernels(kernel, value):
    """At distance 2: exp(-2), and (1 + 2 sqrt 3) exp(-2 sqrt 3)."""
    runner = ExpansionRunner(Expansion(ONE, ONE, packed(np.array([5.0])), kernel), CENTRES)
    assert runner.at(np.array([2.0], np.float32)) == pytest.approx([5 + value], abs=1e-5)


def test_large_weights_that_cancel_keep_their_difference():
    weights = packed(np.array([[60000.0], [-60000.0]]))
    runner = ExpansionRunner(
        Expansion(ONE, weights, packed(np.zeros(1)), "matern"), np.array([[0.25], [-0.25]])
    )
    for x in (0.0625, 0.125):
        near, far = np.sqrt(3) * (0.25 - x), np.sqrt(3) * (0.25 + x)
        exact = 60000 * ((1 + near) * np.exp(-near) - (1 + far) * np.exp(-far))
        assert runner.at(np.array([x], np.float32))[0] == pytest.approx(exact, abs=0.002)


def test_a_file_without_a_kernel_has_the_gaussian_and_is_written_as_it_was():
    old = Expansion(ONE, ONE, ONE)
    text = msgspec.json.encode(old)
    assert b"kernel" not in text
    assert msgspec.json.decode(text, type=Expansion).kernel == "gaussian"
