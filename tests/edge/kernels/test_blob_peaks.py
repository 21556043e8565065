"""Peaks of the determinant against OpenCV's filters and dilation."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.kernels.blob_peaks import BlobPeaks

LIMIT = 30.0


def peaks_of_opencv(plane, reach):
    """Return the highest pixels (n, 2) within reach and their determinants (n,), the strongest first."""
    xx, yy, xy = (cv2.Sobel(plane, cv2.CV_64F, *order, ksize=3) for order in ((2, 0), (0, 2), (1, 1)))
    determinant = np.maximum(xx, 0.0) * yy - xy**2
    highest = cv2.dilate(determinant, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))
    row, column = np.nonzero(((determinant >= highest) & (determinant > LIMIT))[1:-1, 1:-1])
    value = determinant[row + 1, column + 1]
    order = np.argsort(-value)
    return np.stack([column + 1, row + 1], axis=1)[order], value[order]


def smooth_noise(shape, seed=0):
    noise = np.random.default_rng(seed).uniform(0.0, 255.0, shape)
    return cv2.GaussianBlur(noise, (0, 0), 1.5).astype(np.float32)


def peaks(plane, reach=2, most=None, gain=1.0, pixel_px=1):
    finder = BlobPeaks(most)
    np.copyto(finder.plane(plane.shape), plane)
    return finder.find(reach, LIMIT, gain, pixel_px)


@pytest.mark.parametrize("shape", [(120, 160), (41, 67), (3, 3), (5, 19), (33, 18)])
@pytest.mark.parametrize("reach", [1, 2, 5])
def test_peaks_are_those_of_filters_and_dilation(shape, reach):
    plane = smooth_noise(shape)
    expected, value = peaks_of_opencv(plane.astype(np.float64), reach)
    place, strength = peaks(plane, reach)
    assert len(place) == len(expected)
    np.testing.assert_array_less(np.abs(place - expected), 0.5 + 1e-9)
    np.testing.assert_allclose(strength, np.sqrt(value), rtol=1e-3)


def test_the_strongest_are_kept():
    plane = smooth_noise((120, 160))
    every, some = peaks(plane), peaks(plane, most=20)
    assert len(every[1]) > 100
    for whole, part in zip(every, some, strict=True):
        np.testing.assert_array_equal(part, whole[:20])
    assert (np.diff(every[1]) <= 0.0).all()
    assert len(peaks(plane, most=0)[1]) == 0


def test_places_are_of_the_whole_image():
    plane = smooth_noise((60, 80))
    (fine_px, fine), (coarse_px, coarse) = peaks(plane), peaks(plane, gain=2.0, pixel_px=4)
    np.testing.assert_allclose(coarse_px, 4.0 * fine_px + 1.5)
    np.testing.assert_allclose(coarse, 2.0 * fine)


def test_a_paraboloid_of_the_determinant_is_placed_at_its_top():
    row, column = np.mgrid[0:40, 0:50]
    plane = -np.exp(-((column - 20.3) ** 2 + (row - 15.8) ** 2) / 50.0) * 1000.0
    place, _ = peaks(plane.astype(np.float32))
    np.testing.assert_allclose(place, [[20.3, 15.8]], atol=0.02)


def test_equal_pixels_are_all_peaks_and_a_pair_is_one():
    row, column = np.mgrid[0:20, 0:30]
    bowl = (4.0 * (column**2 + row**2)).astype(np.float32)  # its determinant is the same everywhere inside
    assert len(peaks(bowl)[1]) == 18 * 27  # those of the last column are placed half a pixel from others
    two = np.zeros((20, 30), np.float32)
    two[9:12, 10:12] = -100.0
    assert peaks(cv2.GaussianBlur(two, (9, 9), 1.5))[0] == pytest.approx(np.array([[10.5, 10.0]]), abs=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e38])
def test_garbage_ends(value):
    plane = smooth_noise((30, 40))
    plane[5:9, 3:30] = value
    plane[20, 20] = -value
    for reach in (1, 3, 100):
        assert np.isfinite(peaks(plane, reach)[0]).all()
    assert len(peaks(np.full((30, 40), value, np.float32))[1]) == 0


@pytest.mark.parametrize("shape", [(0, 0), (1, 50), (50, 2)])
def test_planes_without_inner_pixels_have_no_peak(shape):
    place, strength = peaks(np.zeros(shape, np.float32))
    assert place.shape == (0, 2) and strength.shape == (0,)
