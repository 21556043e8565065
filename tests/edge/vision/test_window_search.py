"""Beads in small windows: what counts as a bead, by planes on which one bead differs by a known amount."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import erf

from palpate_edge.vision.beads import Reference
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.window_search import WindowSearch

SPACING_PX, DIAMETER_PX, BLUR_PX = 22.0, 9.0, 0.7
REST_PX = 30.25 + SPACING_PX * np.stack(np.meshgrid(np.arange(5), np.arange(5)), axis=-1).reshape(-1, 2)
COUNT, ONE = len(REST_PX), 12
ROW, COLUMN = np.mgrid[0:150, 0:150]


def plane(place_px=REST_PX, contrast=100.0, diameter_px=DIAMETER_PX, glare=None, slope=None) -> np.ndarray:
    """Dark blurred disks on skin of 180; contrast, diameter_px: of each bead. glare: (x, y, grey levels);
    slope: grey levels a pixel, in x and in y, about the bead ONE."""
    grey = np.full(ROW.shape, 180.0)
    contrasts, diameters = (np.broadcast_to(np.asarray(one, float), COUNT) for one in (contrast, diameter_px))
    for (x, y), dark, wide in zip(place_px, contrasts, diameters, strict=True):
        radius = np.hypot(COLUMN - x, ROW - y)
        grey -= dark * 0.5 * (1.0 - erf((radius - wide / 2) / (np.sqrt(2.0) * BLUR_PX)))
    if glare is not None:
        x, y, light = glare
        grey += light * (np.hypot(COLUMN - x, ROW - y) < 6.0)
    if slope is not None:
        x, y = np.clip(np.stack([COLUMN, ROW], axis=-1) - REST_PX[ONE], -10.0, 10.0).transpose(2, 0, 1)
        grey += slope[0] * x + slope[1] * y
    return grey.astype(np.float32)


def one_bead(value: float, others: float) -> np.ndarray:
    values = np.full(COUNT, others)
    values[ONE] = value
    return values


@pytest.fixture(scope="module")
def reference() -> Reference:
    seen = Refiner(np.full(COUNT, DIAMETER_PX), np.full(COUNT, SPACING_PX)).refine(plane(), REST_PX)
    contrast, area = seen.contrast.astype(float), seen.area.astype(float)
    return Reference(
        REST_PX, np.full(COUNT, DIAMETER_PX), contrast, area, None, seen.unevenness.astype(float)
    )


def search(reference: Reference, shown: np.ndarray) -> WindowSearch:
    windows = WindowSearch(reference)
    windows.load(shown)
    return windows


def test_windows_are_counted_for_each_bead(reference) -> None:
    """One where a bead is expected in its place, more where it is off."""
    place = REST_PX.copy()
    place[ONE] += (3.0, 3.0)
    windows = search(reference, plane(place))
    windows.find_beads(REST_PX, COUNT, COUNT)
    assert windows.windows[ONE] in (2, 3)
    assert (np.delete(windows.windows, ONE) == 1).all()


def found_in(reference, shown, expected_px=REST_PX, max_faint=COUNT, after_jump=COUNT):
    return search(reference, shown).find_beads(expected_px, max_faint, after_jump)


def test_all_beads_are_found_at_their_places(reference) -> None:
    off = np.random.default_rng(1).uniform(-3.0, 3.0, (COUNT, 2))
    position, found = found_in(reference, plane(REST_PX + off))
    assert found.all()
    np.testing.assert_allclose(position, REST_PX + off, atol=0.03)
    assert search(reference, plane()).binning == 1


@pytest.mark.parametrize(("share", "is_bead"), [(0.34, False), (0.36, True)])
def test_a_bead_has_a_third_of_its_contrast(reference, share, is_bead) -> None:
    _, found = found_in(reference, plane(contrast=one_bead(100.0 * share, 100.0)))
    assert found[ONE] == is_bead and found.sum() == COUNT - 1 + is_bead


@pytest.mark.parametrize(("area", "is_bead"), [(0.28, False), (0.6, True), (1.7, True), (2.1, False)])
def test_a_bead_has_about_its_area(reference, area, is_bead) -> None:
    """Its diameter over that in the reference is the root of the area's ratio."""
    wide = one_bead(DIAMETER_PX * np.sqrt(area), DIAMETER_PX)
    assert found_in(reference, plane(diameter_px=wide))[1][ONE] == is_bead


@pytest.mark.parametrize("hidden", [2, 3])
def test_with_too_many_faint_places_nothing_is_measured(reference, hidden) -> None:
    contrast = np.full(COUNT, 100.0)
    contrast[:hidden] = 0.0
    labelling = found_in(reference, plane(contrast=contrast), max_faint=2)
    assert (labelling is None) is (hidden == 3)
    if labelling is not None:
        assert labelling[1].sum() == COUNT - 2


@pytest.mark.parametrize(("step", "reaches"), [(0.449, True), (0.451, False)])
def test_a_bead_is_within_0_45_spacings_of_where_it_is_expected(reference, step, reaches) -> None:
    moved = REST_PX + np.array([step * SPACING_PX, 0.0])
    assert WindowSearch(reference).reaches(REST_PX, moved).all() == reaches


@pytest.mark.parametrize(("share", "is_bead"), [(0.19, False), (0.22, True)])
def test_a_predicted_bead_may_have_a_fifth_of_its_contrast(reference, share, is_bead) -> None:
    windows = search(reference, plane(contrast=one_bead(100.0 * share, 100.0)))
    windows.find_beads(REST_PX, COUNT, COUNT)
    position, found = windows.find_missing()
    assert found[ONE] == is_bead and found.sum() == COUNT - 1 + is_bead
    np.testing.assert_allclose(position, REST_PX, atol=0.3)


@pytest.mark.parametrize(
    ("contrast", "off", "is_bead"), [(30.0, 0.19, True), (30.0, 0.22, False), (60.0, 0.22, True)]
)
def test_a_faint_bead_is_near_its_prediction(reference, contrast, off, is_bead) -> None:
    """Within a fifth of the spacing below a third of the contrast."""
    windows = search(reference, plane(contrast=one_bead(contrast, 100.0)))
    windows.find_beads(REST_PX, COUNT, COUNT)
    predicted = REST_PX[[ONE]] + np.array([[0.0, off * SPACING_PX]])
    assert windows.find_matched(REST_PX[[ONE]], np.array([ONE]), predicted)[1][0] == is_bead


@pytest.mark.parametrize(("share", "is_bead"), [(0.09, False), (0.12, True)])
def test_a_matched_blob_has_a_tenth_of_the_contrast(reference, share, is_bead) -> None:
    windows = search(reference, plane(contrast=one_bead(100.0 * share, 100.0)))
    windows.find_beads(REST_PX, COUNT, COUNT)
    assert windows.find_matched(REST_PX[[ONE]], np.array([ONE]), REST_PX[[ONE]])[1][0] == is_bead


def test_a_lost_bead_is_measured_again_where_its_neighbours_predict_it(reference) -> None:
    expected = REST_PX.copy()
    expected[ONE] += (8.0, 8.0)  # its window does not show it
    windows = search(reference, plane())
    _, found = windows.find_beads(expected, COUNT, COUNT)
    assert not found[ONE] and found.sum() == COUNT - 1
    position, again = windows.find_missing()
    assert again.all()
    np.testing.assert_allclose(position, REST_PX, atol=0.05)


@pytest.mark.parametrize(("share", "noise"), [(0.5, 2.0), (0.4, 2.5), (0.71, None)])
def test_a_dim_bead_is_less_exact_by_its_contrast(reference, share, noise) -> None:
    windows = search(reference, plane(contrast=one_bead(100.0 * share, 100.0)))
    _, found = windows.find_beads(REST_PX, COUNT, COUNT)
    measured = windows.noise(found)
    if noise is None:
        assert measured is None
        return
    assert measured[ONE] == pytest.approx(noise, rel=0.05)
    assert (np.delete(measured, ONE) == 1.0).all()
    found[ONE] = False
    assert windows.noise(found) is None  # what is not found has no place


def test_glare_beside_a_bead_hides_it_unless_its_symmetry_is_measured(reference) -> None:
    x, y = REST_PX[ONE]
    shown = plane(glare=(x + 9.0, y, 60.0))
    windows = search(reference, shown)
    assert not windows.find_beads(REST_PX, COUNT, COUNT)[1][ONE]
    excess = float(windows.excess[ONE])
    assert 0.05 < excess < 0.3
    everyone = np.arange(COUNT)
    assert not windows.find_matched(REST_PX, everyone, REST_PX)[1][ONE]
    windows.allow_glare(allowed=True)
    assert windows.find_matched(REST_PX, everyone, REST_PX)[1][ONE]
    expected = min(10.0, 2.5 + 25.0 * excess)
    assert windows.noise(np.ones(COUNT, np.bool_))[ONE] == pytest.approx(expected, rel=1e-3)


SLOPES = ((1.7, 0.0), (0.0, -2.0), (1.5, 1.5))


@pytest.mark.parametrize("slope", SLOPES)
def test_a_bead_in_sloping_light_is_found_where_it_is(reference, slope) -> None:
    """Beside a lamp or in a contact's shade its contrast decides, not that the skin is uneven."""
    windows = search(reference, plane(slope=slope))
    windows.find_beads(REST_PX, COUNT, COUNT)
    assert 0.05 < windows.excess[ONE] < 0.3  # hidden, were this an edge
    position, found = windows.find_missing()
    assert found[ONE]
    assert np.linalg.norm(position[ONE] - REST_PX[ONE]) < 0.05
    plain = Refiner(np.full(COUNT, DIAMETER_PX), np.full(COUNT, SPACING_PX)).refine(
        plane(slope=slope), REST_PX
    )
    assert np.linalg.norm(plain.position_px[ONE] - REST_PX[ONE]) > 0.15


@pytest.mark.parametrize("slope", SLOPES)
def test_a_bead_that_is_uneven_at_rest_is_not_levelled(reference, slope) -> None:
    """Its place in the reference frames is off in the same way."""
    uneven = replace(reference, unevenness=reference.unevenness + one_bead(0.21, 0.0))
    refiner = Refiner(np.full(COUNT, DIAMETER_PX), np.full(COUNT, SPACING_PX))
    shown = plane(slope=2.0 * np.array(slope))
    windows = search(uneven, shown)
    position, _ = windows.find_beads(REST_PX, COUNT, COUNT)
    assert windows.excess[ONE] > 0.0
    np.testing.assert_allclose(position[ONE], refiner.refine(shown, REST_PX).position_px[ONE], atol=1e-6)


def test_unevenness_that_most_beads_share_is_camera_noise(reference) -> None:
    noise = np.random.default_rng(2).normal(0.0, 9.0, ROW.shape)
    _, found = found_in(reference, plane() + noise.astype(np.float32))
    assert found.mean() > 0.9
