"""Standard deviations against NumPy's in double precision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.kernels.deviation import DeviationKernel

STEP = 1 / 256  # of the variance


@pytest.mark.parametrize(("count", "channels"), [(640, 1), (640, 3), (100_000, 1), (70_001, 3), (1, 3)])
@pytest.mark.parametrize("spread", [255, 9])
def test_the_largest_deviation_of_a_channel(count, channels, spread):
    pixels = np.random.default_rng(1).integers(0, spread, (count, channels), dtype=np.uint8, endpoint=True)
    pixels[:, 0] //= 2
    found = DeviationKernel().largest(pixels.tobytes(), channels)
    assert found**2 == pytest.approx(pixels.var(axis=0).max(), abs=2 * STEP)


def test_the_largest_possible_deviation():
    pixels = bytes([0, 255]) * 500_000
    assert DeviationKernel().largest(pixels, 1) == 127.5


@given(st.binary(max_size=50), st.integers(1, 4))
def test_any_pixels(pixels, channels):
    """Pixels that are cut off do not count."""
    whole = np.frombuffer(pixels, np.uint8)[: len(pixels) // channels * channels].reshape(-1, channels)
    expected = whole.astype(float).var(axis=0).max() if len(whole) else 0.0
    assert DeviationKernel().largest(pixels, channels) == pytest.approx(math.sqrt(expected), abs=0.07)
