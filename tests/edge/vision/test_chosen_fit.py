"""Beads beside a dark edge: their centroids lag behind, their symmetry does not."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.vision.bead_fit import ChosenFit
from palpate_edge.vision.beads import EVEN_LIGHT, GREY_FIT, Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.tracker import Tracker

SPACING_PX, DIAMETER_PX, EDGE_PX = 36.0, 14.0, 20.5
REST_PX = 30.25 + SPACING_PX * np.stack(np.meshgrid(np.arange(4), np.arange(4)), axis=-1).reshape(-1, 2)
COUNT = len(REST_PX)
BESIDE = REST_PX[:, 0] < 31.0  # 2.8 px from the edge
ROW, COLUMN = np.mgrid[0:170, 0:170]


def picture(place_px: np.ndarray) -> np.ndarray:
    """Dark disks on skin of 180, which a dark surrounding ends on the left."""
    grey = 180.0 / (1.0 + np.exp(-(COLUMN - EDGE_PX) / 0.7))
    for x, y in place_px:
        grey -= 110.0 / (1.0 + np.exp((np.hypot(COLUMN - x, ROW - y) - DIAMETER_PX / 2) / 0.7))
    return np.clip(grey, 0, 255).astype(np.uint8)


def reference(offset_px: np.ndarray | None = None) -> Reference:
    """Return the beads as centroids, and with an offset the fitted ones' places."""
    seen = Refiner(np.full(COUNT, DIAMETER_PX), np.full(COUNT, SPACING_PX)).refine(picture(REST_PX), REST_PX)
    place_px = seen.position_px if offset_px is None else seen.position_px + np.nan_to_num(offset_px)
    contrast, area, unevenness = (one.astype(float) for one in (seen.contrast, seen.area, seen.unevenness))
    diameter_px = np.full(COUNT, DIAMETER_PX)
    return Reference(
        place_px,
        diameter_px,
        contrast,
        area,
        unevenness=unevenness,
        fit_channels=GREY_FIT,
        fit_light=EVEN_LIGHT,
        fit_offset_px=offset_px,
    )


def offsets() -> np.ndarray:
    """Return how far the beads beside the edge are fitted from their centroids."""
    plain = reference()
    fit = ChosenFit(plain, np.zeros((COUNT, 2)))
    fit.load(picture(REST_PX))
    place_px, _ = fit.fit(plain.position_px, np.ones(COUNT, np.bool_))
    return np.where(BESIDE[:, None], place_px - plain.position_px, np.nan)


@pytest.mark.parametrize("step_px", [(2.0, 0.0), (1.5, 1.5), (3.0, -1.0)])
def test_a_bead_beside_an_edge_moves_as_it_does(step_px: tuple[float, float]) -> None:
    shown = picture(REST_PX + step_px)
    errors = []
    for offset_px in (None, offsets()):
        rest = reference(offset_px)
        beads = Tracker(rest).follow(shown, shown)
        assert beads.found.all()
        errors.append(np.linalg.norm(beads.position_px - rest.position_px - step_px, axis=1))
    centroids, chosen = errors
    assert chosen[BESIDE].max() < 0.4 * centroids[BESIDE].min()
    np.testing.assert_array_equal(chosen[~BESIDE], centroids[~BESIDE])
    assert centroids[~BESIDE].max() < 0.1


def test_a_bead_that_is_not_where_it_is_expected_is_lost() -> None:
    fit = ChosenFit(reference(), np.where(BESIDE[:, None], [0.0, 0.0], np.nan))
    fit.load(picture(REST_PX))
    _, found = fit.fit(REST_PX + 4.5, np.ones(COUNT, np.bool_))
    assert found[~BESIDE].all() and not found[BESIDE].any()
