"""Halved colour images: means of two by two bytes, rounded, and a weighted sum of the colours."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.kernels.halving import HalvedColours

WEIGHTS = (0.5, -1.0, 0.25)


def halves(image: np.ndarray) -> np.ndarray:
    """Return the means in whole numbers, halves rounded up."""
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    whole = image[: 2 * rows, : 2 * columns].astype(int)
    return (whole.reshape(rows, 2, columns, 2, 3).sum(axis=(1, 3)) + 2) // 4


@given(st.integers(0, 2**32 - 1), st.integers(2, 11), st.integers(2, 45))
def test_any_size_has_the_rounded_means_and_their_sum(seed: int, height: int, width: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    small, plane = HalvedColours().read(image, WEIGHTS)
    assert np.array_equal(small, halves(image))
    assert np.array_equal(plane, halves(image) @ np.array(WEIGHTS))  # such weights make exact sums


def test_memory_is_reused_and_follows_the_size() -> None:
    random, reader = np.random.default_rng(2), HalvedColours()
    first, _ = reader.read(random.integers(0, 256, (8, 12, 3), dtype=np.uint8), WEIGHTS)
    image = random.integers(0, 256, (9, 13, 3), dtype=np.uint8)
    again, _ = reader.read(image, WEIGHTS)
    assert again is first
    assert np.array_equal(again, halves(image))
    taller = random.integers(0, 256, (12, 12, 3), dtype=np.uint8)
    assert np.array_equal(reader.read(taller, WEIGHTS)[0], halves(taller))


def test_rows_of_a_part_of_an_image_are_read_where_they_are() -> None:
    image = np.random.default_rng(3).integers(0, 256, (20, 40, 3), dtype=np.uint8)
    part = image[3:15, 7:33]
    assert np.array_equal(HalvedColours().read(part, WEIGHTS)[0], halves(part))


@pytest.mark.parametrize("image", [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3), np.float32)])
def test_other_images_are_refused(image: np.ndarray) -> None:
    with pytest.raises(TypeError, match="no colour image of bytes"):
        HalvedColours().read(image, WEIGHTS)
