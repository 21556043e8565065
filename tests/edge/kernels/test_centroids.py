"""Centroids in windows: the same as by sums over all pixels, and places anywhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.vision.subpixel import DISK_RADIUS, GATE, Refiner

DIAMETER_PX = 8.0
ANYWHERE = st.one_of(st.floats(), st.floats(-50.0, 90.0))


def by_definition(plane: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centroid and contrast of one window about a place, far from the plane's edges."""
    column, row = np.rint(place).astype(int)

    def circle(radius: float) -> np.ndarray:
        angle = 2 * np.pi * np.arange(16) / 16
        dx, dy = (np.rint(radius * way(angle)).astype(int) for way in (np.cos, np.sin))
        return plane[row + dy, column + dx].astype(float)

    skin = np.sort(circle(0.8 * DIAMETER_PX))[6:14].mean()
    contrast = skin - circle(0.25 * DIAMETER_PX).mean()
    y, x = np.mgrid[0 : plane.shape[0], 0 : plane.shape[1]]
    darker = np.clip((skin - plane) / max(contrast, 1.0) - GATE, 0.0, 1.0)
    darker[np.hypot(x - column, y - row) > DISK_RADIUS * DIAMETER_PX] = 0.0
    weight = darker**2 * (3.0 - 2.0 * darker)
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum(), contrast


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_one_window_is_a_sum_over_its_pixels(kind):
    random = np.random.default_rng(4)
    y, x = np.mgrid[0:60, 0:70]
    dark = (
        150.0 - 90.0 * np.exp(-(((x - 33.4) ** 2 + (y - 28.7) ** 2) / 14.0)) + random.normal(0, 3, (60, 70))
    )
    plane = dark.astype(kind)
    refiner = Refiner(np.full(1, DIAMETER_PX))
    refiner.load(plane)
    start = np.array([[32.6, 29.9]])
    found = refiner.centroids(start, max_steps=1)
    place, contrast = by_definition(plane, start[0])
    assert np.allclose(found.position_px[0], place, atol=1e-4)
    assert found.contrast[0] == pytest.approx(contrast, rel=1e-5)
    assert found.windows[0] == 1


@given(x=ANYWHERE, y=ANYWHERE, height=st.integers(1, 30), width=st.integers(1, 30), bytes_=st.booleans())
def test_no_place_leads_outside_the_plane(x, y, height, width, bytes_):
    plane = (
        np.random.default_rng(5).integers(0, 256, (height, width)).astype(np.uint8 if bytes_ else np.float32)
    )
    refiner = Refiner(np.full(2, DIAMETER_PX))
    refiner.load(plane)
    found = refiner.centroids(np.array([[x, y], [0.0, 0.0]]))
    assert np.isfinite(found.position_px[1]).all()
    if x < 0 or y < 0 or x > width - 1 or y > height - 1:
        assert found.contrast[0] == 0.0
        assert np.array_equal(found.position_px[0], (x, y), equal_nan=True)


def test_a_plane_of_nothing_and_other_numbers_of_beads_are_refused():
    refiner = Refiner(np.full(2, DIAMETER_PX))
    with pytest.raises(ValueError, match="shows no bead"):
        refiner.load(np.zeros((0, 5), np.float32))
    refiner.load(np.zeros((5, 5), np.float32))
    with pytest.raises(ValueError, match="2 beads"):
        refiner.centroids(np.zeros((3, 2)))
    with pytest.raises(ValueError, match="not among"):
        refiner.centroids(np.zeros((1, 2)), np.array([2]))
