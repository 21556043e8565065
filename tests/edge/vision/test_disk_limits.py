"""The profile of a disk whose edge is known on every ray, and the limits within which a blob is a disk."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.vision.disk_profile import DiskProfile, disk_profile

SEARCHED_PX = 20.0
CENTRE_PX = np.array([[60.0, 60.0]])
CORE, SKIN = 40.0, 200.0


def cone(inner_px: float, outer_px: float, at: tuple[float, float] = (60.0, 60.0)) -> np.ndarray:
    """A dark disk whose grey grows evenly from the inner to the outer radius."""
    row, column = np.mgrid[0:121, 0:121]
    radius = np.hypot(column - at[0], row - at[1])
    return CORE + (SKIN - CORE) * np.clip((radius - inner_px) / (outer_px - inner_px), 0.0, 1.0)


@pytest.mark.parametrize(("inner_px", "outer_px"), [(7.0, 13.0), (8.5, 11.5), (10.0, 14.0), (6.0, 9.0)])
def test_the_edge_is_where_the_grey_is_half_way(inner_px: float, outer_px: float) -> None:
    found = disk_profile(cone(inner_px, outer_px), CENTRE_PX, SEARCHED_PX)
    assert SEARCHED_PX * found.diameter[0] == pytest.approx(inner_px + outer_px, rel=0.01)
    assert found.contrast[0] == pytest.approx(SKIN - CORE, abs=0.5)
    assert found.oval[0] < 0.01
    assert found.offset[0] < 0.002
    assert found.isolation[0] == pytest.approx(1.0, abs=0.01)


def test_the_offset_is_that_of_the_circles_centre() -> None:
    found = disk_profile(cone(8.0, 12.0, (61.0, 58.5)), CENTRE_PX, SEARCHED_PX)
    assert SEARCHED_PX * found.offset[0] == pytest.approx(np.hypot(1.0, 1.5), rel=0.03)
    assert SEARCHED_PX * found.diameter[0] == pytest.approx(20.0, rel=0.02)


def test_an_ellipse_is_oval_by_its_deviation_from_a_circle() -> None:
    """Radii 10 (1 + e cos 2 phi): the standard deviation over the mean is e / sqrt 2."""
    row, column = np.mgrid[0:121, 0:121] - 60
    radius, angle = np.hypot(column, row), np.arctan2(row, column)
    edge = 10.0 * (1.0 + 0.2 * np.cos(2.0 * angle))
    grey = CORE + (SKIN - CORE) * np.clip((radius - edge + 2.0) / 4.0, 0.0, 1.0)
    assert disk_profile(grey, CENTRE_PX, SEARCHED_PX).oval[0] == pytest.approx(0.2 / np.sqrt(2.0), rel=0.05)


def test_the_third_darkest_ray_of_the_skin_is_the_isolation() -> None:
    """A neighbour that covers a quarter of the skin, half as dark as the core."""
    grey = cone(6.0, 9.0)
    grey[:, 76:] = 0.5 * (CORE + SKIN)
    found = disk_profile(grey, CENTRE_PX, SEARCHED_PX)
    assert found.isolation[0] == pytest.approx(0.5, abs=0.01)
    narrow = cone(6.0, 9.0)
    narrow[59:62, 76:] = CORE
    assert disk_profile(narrow, CENTRE_PX, SEARCHED_PX).isolation[0] > 0.95


def test_a_place_without_an_edge_is_as_wide_as_can_be() -> None:
    flat = disk_profile(np.full((121, 121), 100.0), CENTRE_PX, SEARCHED_PX)
    assert flat.diameter[0] == pytest.approx(2.8)
    assert not flat.is_disk()[0]


GOOD = {"contrast": 100.0, "diameter": 1.0, "oval": 0.05, "isolation": 0.9, "offset": 0.05, "filled": 1.0}


@pytest.mark.parametrize(
    ("name", "inside", "outside"),
    [
        ("oval", 0.149, 0.151),
        ("isolation", 0.651, 0.649),
        ("offset", 0.249, 0.251),
        ("diameter", 0.601, 0.599),
        ("diameter", 1.499, 1.501),
    ],
)
def test_each_limit(name: str, inside: float, outside: float) -> None:
    values = {**{one: np.full(2, value) for one, value in GOOD.items()}, name: np.array([inside, outside])}
    assert DiskProfile(**values).is_disk().tolist() == [True, False]
    is_lower = inside > outside
    for tolerance in (1.2, 0.8):
        scale = 1.0 / tolerance if is_lower else tolerance
        scaled = {**values, name: scale * np.array([inside, outside])}
        assert DiskProfile(**scaled).is_disk(tolerance).tolist() == [True, False]


def test_a_disk_is_filled_at_any_tolerance() -> None:
    values = {**{one: np.full(2, value) for one, value in GOOD.items()}, "filled": np.array([0.781, 0.779])}
    for tolerance in (1.0, 1.5):
        assert DiskProfile(**values).is_disk(tolerance).tolist() == [True, False]
