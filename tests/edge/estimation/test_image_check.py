"""Blank frames: those whose grey levels deviate by less than 2 over the image."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.estimation.frame_record import FrameRejectedError
from palpate_edge.estimation.image_check import ImageCheck

HEIGHT, WIDTH = 480, 640


def is_blank(image):
    try:
        ImageCheck((WIDTH, HEIGHT), "grey").check_image(image)
    except FrameRejectedError as rejection:
        return str(rejection) == "frame is blank"
    return False


@pytest.mark.parametrize("deviation", [1.0, 3.0, 30.0])
@pytest.mark.parametrize("channels", [(), (3,)])
def test_noise_is_blank_below_two_grey_levels(deviation, channels):
    noise = np.random.default_rng(1).normal(128.0, deviation, (HEIGHT, WIDTH, *channels))
    assert is_blank(np.clip(np.rint(noise), 0, 255).astype(np.uint8)) == (deviation < 2.0)


@pytest.mark.parametrize("depth", [6, 20])
def test_one_row_counts_as_one_of_those_that_are_read(depth):
    """One of twelve rows that deviates by 6 or 20 grey levels makes 1.7 or 5.8 over all of them."""
    image = np.full((HEIGHT, WIDTH), 100, np.uint8)
    image[240, ::2] += depth
    image[240, 1::2] -= depth
    assert is_blank(image) == (depth / np.sqrt(12) < 2.0)


def test_rows_that_differ_from_each_other_are_not_blank():
    image = np.repeat(np.linspace(50, 200, HEIGHT).astype(np.uint8)[:, None], WIDTH, axis=1)
    assert not is_blank(image)


@pytest.mark.parametrize("channel", ["blue", "blue-red"])
def test_a_grey_frame_of_coloured_beads_is_refused(channel):
    check = ImageCheck((WIDTH, HEIGHT), channel)
    noise = np.random.default_rng(1).integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    check.check_image(noise)
    with pytest.raises(
        FrameRejectedError, match=f"frame is grey, the calibration finds the beads on {channel}: "
    ):
        check.check_image(noise[..., 0])
