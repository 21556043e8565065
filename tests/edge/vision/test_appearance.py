"""Planes of a colour image: weighted sums of its channels, signed so that beads are dark."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.vision.appearance import CHANNELS, Appearance, colour_weights, plane


@pytest.mark.parametrize("channel", [name for name in CHANNELS if name != "grey"])
@pytest.mark.parametrize("bright", [False, True])
def test_a_plane_is_the_weighted_sum_of_the_channels(channel: str, bright: bool) -> None:
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    expected = image.astype(np.float64) @ np.array(CHANNELS[channel]) * (-1.0 if bright else 1.0)
    found = plane(image, Appearance(channel, bright))
    assert found.dtype == np.float32
    assert np.array_equal(found, expected)
    assert np.array_equal(image @ np.array(colour_weights(Appearance(channel, bright))), expected)
