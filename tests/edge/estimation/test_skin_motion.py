"""The skin's motion on an untouched sensor whose beads are not all seen equally well."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.vision.beads import Beads, Reference

SIDE, SPACING_PX = 9, 30.0
REST_PX = SPACING_PX * np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)


@pytest.mark.parametrize("noisy_share", [0.15, 0.5, 1.0])
def test_motion_over_its_noise_is_the_same_in_any_light(noisy_share):
    """Places have 0.1 px of noise, six times as much in a part of the dome; one threshold serves both."""
    count, random = len(REST_PX), np.random.default_rng(3)
    one = np.ones(count)
    skin = SkinMotion(Reference(REST_PX, 12 * one, 90 * one, one))
    noise = np.where(np.arange(count) < noisy_share * count, 6.0, 1.0)
    everywhere = np.ones(count, dtype=np.bool_)
    motions = []
    for level in (None, noise):
        deviation = 0.1 * (one if level is None else level)
        sizes = []
        for _ in range(60):
            places = REST_PX + deviation[:, None] * random.standard_normal(REST_PX.shape)
            moved = skin.measure(
                Beads.from_positions(
                    places, everywhere, noise=None if level is None else level.astype(np.float32)
                )
            )
            sizes.append(moved.size_px / moved.noise)
        motions.append(np.sqrt(np.mean(np.square(sizes))))
    exact, mixed = motions
    assert mixed == pytest.approx(exact, rel=0.2)
