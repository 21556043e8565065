"""Halved colour images: means of two by two bytes, rounded, and a weighted sum of the colours."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.kernels.halving import HalvedImage
from palpate_edge.vision.subpixel import Refiner
from palpate_edge.vision.symmetric_fit import SymmetricFit

WEIGHTS = (0.5, -1.0, 0.25)


def halves(image: np.ndarray) -> np.ndarray:
    """Return the means in whole numbers, halves rounded up."""
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    whole = image[: 2 * rows, : 2 * columns].astype(int)
    return (whole.reshape(rows, 2, columns, 2, 3).sum(axis=(1, 3)) + 2) // 4


def whole(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    reader = HalvedImage()
    reader.begin(image, WEIGHTS)
    return reader.complete()


@given(st.integers(0, 2**32 - 1), st.integers(2, 11), st.integers(2, 45))
def test_any_size_has_the_rounded_means_and_their_sum(seed: int, height: int, width: int) -> None:
    image = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
    small, plane = whole(image)
    assert np.array_equal(small, halves(image))
    assert np.array_equal(plane, halves(image) @ np.array(WEIGHTS))  # such weights make exact sums
    grey, same = whole(image[:, :, 1].copy())
    assert grey is same and np.array_equal(grey, halves(image)[:, :, 1])


@given(st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=5), st.booleans())
def test_pixels_are_made_as_they_are_read(places: list[tuple[float, float]], is_grey: bool) -> None:
    """Centroids in an image that is made in parts are those in the whole one, from any start."""
    image = np.random.default_rng(4).integers(0, 256, (90, 140, 3), dtype=np.uint8)
    image = image[:, :, 0].copy() if is_grey else image
    refiner, reader = Refiner(np.full(len(places), 14.0)), HalvedImage()
    for _ in range(2):  # the second image has the memory of the first one
        image = 255 - image
        reader.begin(image, WEIGHTS)
        refiner.load_halved(reader)
        in_parts = refiner.centroids(np.array(places))
    refiner.load(whole(image)[1].repeat(2, axis=0).repeat(2, axis=1))
    at_once = msgspec.structs.astuple(refiner.centroids(np.array(places)))
    for part, expected in zip(msgspec.structs.astuple(in_parts), at_once, strict=True):
        np.testing.assert_array_equal(part, expected)


@given(st.lists(st.tuples(st.floats(-50, 200), st.floats(-50, 200)), min_size=1, max_size=5))
def test_the_symmetric_fit_reads_only_pixels_that_are_made(places: list[tuple[float, float]]) -> None:
    image = np.random.default_rng(5).integers(0, 256, (90, 140, 3), dtype=np.uint8)
    fit = SymmetricFit(np.full(len(places), 14.0), np.full(len(places), 40.0))
    reader = HalvedImage()
    for _ in range(2):  # the second image has the memory of the first one
        image = 255 - image
        reader.begin(image, WEIGHTS)
        fit.load_halved(reader)
        in_parts = fit.measure(np.array(places))
    fit.load(image)
    np.testing.assert_array_equal(in_parts.position_px, fit.measure(np.array(places)).position_px)


def test_memory_is_reused_and_follows_the_size() -> None:
    random, reader = np.random.default_rng(2), HalvedImage()
    reader.begin(random.integers(0, 256, (8, 12, 3), dtype=np.uint8), WEIGHTS)
    first, _ = reader.complete()
    image = random.integers(0, 256, (9, 13, 3), dtype=np.uint8)
    reader.begin(image, WEIGHTS)
    again, _ = reader.complete()
    assert again is first
    assert np.array_equal(again, halves(image))
    taller = random.integers(0, 256, (12, 12, 3), dtype=np.uint8)
    reader.begin(taller, WEIGHTS)
    assert np.array_equal(reader.complete()[0], halves(taller))


def test_rows_of_a_part_of_an_image_are_read_where_they_are() -> None:
    image = np.random.default_rng(3).integers(0, 256, (20, 40, 3), dtype=np.uint8)
    part = image[3:15, 7:33]
    assert np.array_equal(whole(part)[0], halves(part))


def test_an_image_without_two_rows_is_refused_by_its_readers() -> None:
    refiner, fit = Refiner(np.full(2, 14.0)), SymmetricFit(np.full(2, 14.0), np.full(2, 40.0))
    reader = HalvedImage()
    for image in (None, np.zeros((1, 40, 3), np.uint8)):
        if image is not None:
            reader.begin(image, WEIGHTS)
        with pytest.raises(ValueError, match="shows no bead"):
            refiner.load_halved(reader)
        with pytest.raises(ValueError, match="shows no bead"):
            fit.load_halved(reader)


@pytest.mark.parametrize(
    "image",
    [np.zeros((4, 8), np.uint8)[:, ::2], np.zeros((4, 4, 2), np.uint8), np.zeros((4, 4, 3), np.float32)],
)
def test_other_images_are_refused(image: np.ndarray) -> None:
    with pytest.raises(TypeError, match="no image of bytes"):
        HalvedImage().begin(image, WEIGHTS)
