"""The contact threshold in newtons, and the beads at rest, against skins that are known."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.measurement import (
    THRESHOLD_FLOOR_PX,
    bead_noise_px,
    force_that_moves,
    rest_places,
    threshold_above,
    typical_noise,
    with_less_noise,
)
from palpate_edge.vision.beads import Beads


def test_it_is_the_force_at_which_the_stiffest_place_moves_so_far():
    """Half of the places move 2 px a newton, half 1 px: 0.03 px are 0.03 N at the stiff ones."""
    force_N = np.linspace(0.01, 0.3, 200)
    motion_px = force_N * np.where(np.arange(200) % 2, 2.0, 1.0)
    assert force_that_moves(0.03, force_N, motion_px) == pytest.approx(0.03)


def test_heavy_presses_that_the_skin_gives_way_to_less_do_not_count():
    """Force grows with the square of the motion beyond 0.1 N, so that a newton moves it less and less."""
    force_N = np.linspace(0.01, 0.3, 300)
    motion_px = np.where(force_N < 0.12, force_N, np.sqrt(0.12 * force_N))
    assert force_that_moves(0.02, force_N, motion_px) == pytest.approx(0.02)


def test_presses_of_no_known_force_tell_none():
    assert force_that_moves(0.02, np.zeros(5), np.ones(5)) is None
    assert force_that_moves(0.02, np.zeros(0), np.zeros(0)) is None
    assert force_that_moves(0.02, np.array([0.0, 0.5]), np.array([9.0, 1.0])) == pytest.approx(0.01)


def test_one_bad_frame_does_not_set_the_threshold_of_all():
    quiet = np.linspace(0.04, 0.06, 20)
    assert threshold_above(quiet) == pytest.approx(2 * 0.055)
    assert threshold_above(np.append(quiet, 0.1)) < 0.13
    assert threshold_above(np.append(quiet, 0.1)) > 0.1


def test_no_threshold_is_lower_than_what_warming_moves_between_frames():
    assert threshold_above(np.full(9, 1e-4)) == THRESHOLD_FLOOR_PX


def test_places_at_rest_are_means_over_all_untouched_frames():
    """Of 16 frames a mean errs by a quarter of the noise; a bead far off in one of them changes little."""
    random = np.random.default_rng(1)
    true_px = random.uniform(0, 400, (60, 2))
    rest = []
    for frame in range(16):
        noise = np.where(np.arange(60) < 20, 4.0, 1.0)
        places = true_px + 0.1 * noise[:, None] * random.standard_normal((60, 2))
        found = np.arange(60) != 59
        if frame == 3:
            places[30] += 8.0
        rest.append(Beads.from_positions(places, found, noise=noise.astype(np.float32)))
    places = rest_places(rest, true_px + 1.0)
    error = np.linalg.norm(places - true_px, axis=1)
    assert np.sqrt((error[20:59] ** 2).mean()) < 1.3 * 0.1 * np.sqrt(2 / 16)
    assert error[30] < 0.12
    assert np.allclose(places[59], true_px[59] + 1.0)
    assert bead_noise_px(rest, places) == pytest.approx(0.1, rel=0.1)


def test_noise_is_relative_to_the_typical_frame_and_not_to_better_reference_frames():
    """Uncompressed reference frames make all others look three times as inexact."""
    places, everywhere = np.zeros((40, 2)), np.ones(40, dtype=np.bool_)
    noise = np.where(np.arange(40) < 10, 12.0, 3.0).astype(np.float32)
    frames = [Beads.from_positions(places, everywhere, noise=noise)] * 5
    assert typical_noise(frames) == pytest.approx(3.0)
    assert with_less_noise(frames[0], 3.0).noise.tolist() == [4.0] * 10 + [1.0] * 30
    assert with_less_noise(frames[0], 12.0).all_exact
    assert typical_noise([]) == 1.0
