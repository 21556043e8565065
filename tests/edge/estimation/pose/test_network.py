"""Networks about the labels: values worked out by hand, and a label that saturates."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.pose.regression.network_training import fit_networks
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.network import NetworkLayer, NetworkRunner, Networks


def test_the_mean_output_of_two_networks():
    """Input (7 - 3) 0.25 = 1; tanh(1) = 0.761594, tanh(0) = 0; outputs 3 times it + 1, and 5; size 10."""
    first = NetworkLayer(packed(np.array([[[1.0]], [[0.0]]])), packed(np.zeros((2, 1, 1))))
    last = NetworkLayer(packed(np.array([[[3.0]], [[4.0]]])), packed(np.array([[[1.0]], [[5.0]]])))
    networks = Networks(
        (0,), packed(np.array([3.0])), packed(np.array([0.25])), (first, last), packed(np.array([10.0]))
    )
    got = NetworkRunner(networks).at(np.array([7.0]))
    assert got == pytest.approx([10 * (3 * 0.761594 + 1 + 5) / 2], rel=1e-5)


def test_a_step_is_learned_as_its_median_by_presses_left_out():
    """One in five targets is an outlier: a mean would be 0.2 off."""
    random = np.random.default_rng(5)
    inputs = random.uniform(-1, 1, (700, 2))
    truth = np.sign(inputs[:, :1])
    noisy = truth + (random.uniform(size=truth.shape) < 0.2)
    fitted = fit_networks(inputs[:600], noisy[:600], [0])
    runner = NetworkRunner(fitted.networks)
    new = np.array([runner.at(one) for one in inputs[600:]])
    far = np.abs(inputs[:, 0]) > 0.2
    assert np.abs(new - truth[600:])[far[600:]].mean() < 0.1
    assert np.abs(fitted.left_out - truth[:600])[far[:600]].mean() < 0.15
