"""The shape of blobs against disks of known diameter, and against what is no disk."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.vision.disk_profile import disk_profile

SEARCHED_PX = 11.0


@settings(max_examples=25, deadline=None)
@given(
    diameter=st.floats(7.5, 15.0),
    x=st.floats(-0.5, 0.5),
    y=st.floats(-0.5, 0.5),
    skin=st.integers(80, 230),
    slope=st.floats(-0.8, 0.8),
)
def test_a_disk_is_told_its_size_on_light_that_slopes(diameter, x, y, skin, slope):
    row, column = np.mgrid[0:81, 0:81]
    cover = np.clip(diameter / 2 - np.hypot(column - 40 - x, row - 40 - y) + 0.5, 0, 1)
    grey = (1 - cover) * np.clip(skin + slope * (column - 40), 0, 255) + cover * 0.2 * skin
    found = disk_profile(grey.astype(np.uint8), np.array([[40.0, 40.0]]), SEARCHED_PX)
    assert found.is_disk().all()
    assert SEARCHED_PX * found.diameter[0] == pytest.approx(diameter, rel=0.1)
    assert found.contrast[0] == pytest.approx(0.8 * skin, abs=0.1 * skin)
    assert SEARCHED_PX * found.offset[0] == pytest.approx(np.hypot(x, y), abs=0.25)


@pytest.mark.parametrize("x", [0.0, 1.5, 2.5])
def test_the_reflection_of_a_light_on_a_bead_is_no_edge(x):
    grey = np.full((81, 81), 200, dtype=np.uint8)
    cv2.circle(grey, (40 * 16, 40 * 16), 96, 40, -1, cv2.LINE_AA, 4)  # 12 px wide, in sixteenths of a pixel
    cv2.circle(grey, (round(16 * (40 + x)), 40 * 16), 24, 255, -1, cv2.LINE_AA, 4)
    found = disk_profile(cv2.GaussianBlur(grey, (0, 0), 0.7), np.array([[40.0, 40.0]]), SEARCHED_PX)
    assert found.is_disk().all()
    assert SEARCHED_PX * found.diameter[0] == pytest.approx(12.0, rel=0.1)
    assert found.contrast[0] == pytest.approx(160.0, rel=0.2)


def checkerboard(picture):
    row, column = np.indices(picture.shape) // 11
    picture[(row + column) % 2 == 0] = 40
    return picture


@pytest.mark.parametrize(
    "shape",
    [
        pytest.param(lambda picture: cv2.line(picture, (40, 0), (40, 80), 40, 8), id="bar"),
        pytest.param(lambda picture: cv2.rectangle(picture, (40, 0), (80, 80), 40, -1), id="edge"),
        pytest.param(lambda picture: cv2.putText(picture, "V", (24, 56), 0, 1.6, 40, 5), id="letter"),
        pytest.param(checkerboard, id="checkerboard"),
    ],
)
def test_bars_edges_letters_and_checkerboards_are_no_disks(shape):
    grey = cv2.GaussianBlur(shape(np.full((81, 81), 180, dtype=np.uint8)), (0, 0), 0.7)
    places = np.stack(np.meshgrid(np.arange(30, 51, 2), np.arange(30, 51, 2)), axis=-1).reshape(-1, 2)
    assert not disk_profile(grey, places.astype(float), SEARCHED_PX).is_disk().any()


def test_no_places_have_no_profile():
    assert disk_profile(np.zeros((20, 20), np.uint8), np.zeros((0, 2)), 5.0).is_disk().shape == (0,)
