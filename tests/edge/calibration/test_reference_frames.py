"""Reference frames compared with each other: touches by their shape, drift by its lack of one."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.reference_frames import compare_references
from palpate_edge.common.arrays import Array

FRAMES, NOISE_PX = 20, 0.02


def frames(noise_px: float = NOISE_PX) -> Array:
    """Return the places (20, 100, 2) of a grid of beads 20 px apart, with noise."""
    grid = 20.0 * np.stack(np.meshgrid(np.arange(10.0), np.arange(10.0)), axis=-1).reshape(-1, 2)
    return grid + noise_px * np.random.default_rng(3).standard_normal((FRAMES, 100, 2))


def dent(places_px: Array, size_px: float) -> Array:
    """Return displacements (n, 2) away from a contact beside the middle, at most `size_px`."""
    off = places_px - (130.0, 70.0)
    return size_px * off / 30.0 * np.exp(0.5 - 0.5 * (np.linalg.norm(off, axis=1) / 30.0) ** 2)[:, None]


@pytest.mark.parametrize("touched", [[4], [0, 19], list(range(7, 13))])
def test_touched_frames_are_named(touched: list[int]) -> None:
    places_px = frames()
    places_px[touched] += dent(places_px[0], 0.5)
    faults = compare_references(places_px)
    assert faults.touched.tolist() == touched
    assert not len(faults.moved)


def test_touches_of_any_size_are_named() -> None:
    places_px = frames()
    for number in range(11, FRAMES):
        places_px[number] += dent(places_px[0], 0.2 * number)
    assert compare_references(places_px).touched.tolist() == list(range(11, FRAMES))


def test_a_moved_camera_is_no_touch() -> None:
    places_px = frames()
    centre = places_px[0].mean(axis=0)
    places_px[15:] += (0.4, 0.2) + 0.004 * (places_px[15:] - centre)  # shifted and nearer
    faults = compare_references(places_px)
    assert faults.moved.tolist() == list(range(15, FRAMES))
    assert not len(faults.touched)


@pytest.mark.parametrize("noise_px", [0.0, 0.02, 0.3])
def test_noise_and_slow_drift_are_no_fault(noise_px: float) -> None:
    places_px = frames(noise_px)
    places_px += np.linspace(0.0, 0.2, FRAMES)[:, None, None]
    faults = compare_references(places_px)
    assert not len(faults.touched)
    assert not len(faults.moved)


def test_one_frame_alone_has_no_fault() -> None:
    faults = compare_references(frames()[:1])
    assert not len(faults.touched)
    assert not len(faults.moved)
