"""The window search's rules by NumPy, from centroids that are measured alone; and places without sense."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.vision.beads import Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.window_search import WindowSearch

SPACING_PX, DIAMETER_PX, SIDE = 22.0, 9.0, 5
REST_PX = 30.25 + SPACING_PX * np.stack(np.meshgrid(*[np.arange(SIDE)] * 2), axis=-1).reshape(-1, 2)
COUNT = len(REST_PX)
ROW, COLUMN = np.mgrid[0:150, 0:150]
RANDOM = np.random.default_rng(5)
CONTRAST = RANDOM.uniform(60.0, 120.0, COUNT)


def plane(place_px: np.ndarray, contrast: np.ndarray) -> np.ndarray:
    grey = np.full(ROW.shape, 180.0)
    for (x, y), dark in zip(place_px, contrast, strict=True):
        grey -= dark / (1.0 + np.exp((np.hypot(COLUMN - x, ROW - y) - DIAMETER_PX / 2) / 0.5))
    return grey.astype(np.float32)


def refiner() -> Refiner:
    return Refiner(np.full(COUNT, DIAMETER_PX), np.full(COUNT, SPACING_PX))


def reference() -> Reference:
    seen = refiner().refine(plane(REST_PX, CONTRAST), REST_PX)
    contrast, area = seen.contrast.astype(float), seen.area.astype(float)
    diameter = np.full(COUNT, DIAMETER_PX)
    return Reference(REST_PX, diameter, contrast, area, unevenness=seen.unevenness.astype(float))


REFERENCE = reference()


@pytest.mark.parametrize("seed", range(6))
def test_beads_are_accepted_by_contrast_area_unevenness_and_step(seed: int) -> None:
    random = np.random.default_rng(seed)
    shown = plane(REST_PX + random.uniform(-0.3, 0.3, (COUNT, 2)), CONTRAST * random.uniform(0.2, 1.2, COUNT))
    shown += random.normal(0.0, random.uniform(0.0, 12.0), shown.shape).astype(np.float32)
    seen = refiner()
    seen.load(shown)
    one = seen.centroids(REST_PX, None, 1)
    share = one.contrast / REFERENCE.contrast
    excess = one.unevenness - REFERENCE.unevenness - 0.08
    if (excess >= 0).any():
        excess = excess - max(0.0, np.sort(excess)[COUNT // 2] + 0.08)
    step = np.linalg.norm(one.position_px - REST_PX, axis=1)
    first_windows_end_it = one.converged | (share <= 0.35)
    expected = (share > 0.35) & one.converged & (step < 0.45 * SPACING_PX) & (excess < 0)
    expected &= (one.area > 0.45 * REFERENCE.area) & (one.area < 1.9 * REFERENCE.area)
    windows = WindowSearch(REFERENCE)
    windows.load(shown)
    position_px, found = windows.find_beads(REST_PX, COUNT, COUNT)
    assert first_windows_end_it.sum() > COUNT - 5
    np.testing.assert_array_equal(found[first_windows_end_it], expected[first_windows_end_it])
    both = found & first_windows_end_it
    np.testing.assert_allclose(position_px[both], one.position_px[both], atol=1e-9)


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.floats(), st.floats()), min_size=COUNT, max_size=COUNT),
    st.lists(st.floats(-50.0, 300.0), min_size=COUNT, max_size=COUNT),
    st.integers(0, COUNT),
)
def test_places_and_planes_without_sense_end(places, greys, max_faint) -> None:
    expected_px = np.array(places)
    windows = WindowSearch(replace(REFERENCE, unevenness=np.zeros(COUNT)))
    windows.load(plane(REST_PX, np.array(greys)))
    for _ in range(2):
        windows.find_beads(expected_px, max_faint, max_faint)
        position_px, found = windows.find_missing()
        assert position_px.shape == (COUNT, 2) and found.shape == (COUNT,)
        some = np.arange(0, COUNT, 2)
        position_px, found = windows.find_matched(expected_px[some], some, expected_px[::-1][some])
        assert len(position_px) == len(found) == len(some)
        noise = windows.noise(np.ones(COUNT, np.bool_))
        assert noise is None or ((noise >= 1.0) & (noise <= 10.0)).all()


@pytest.mark.parametrize("number", [-1, COUNT, 2**40])
def test_numbers_of_no_bead_are_refused(number: int) -> None:
    windows = WindowSearch(REFERENCE)
    windows.load(plane(REST_PX, CONTRAST))
    beads = np.array([1, number])
    with pytest.raises(IndexError, match="not all of 25"):
        windows.find_matched(REST_PX[:2], beads, REST_PX[:2])
    with pytest.raises(ValueError, match="shape"):
        windows.find_matched(REST_PX[:3], np.arange(2), REST_PX[:2])
