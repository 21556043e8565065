"""A fingertip without calibration: pictures are measured, and no contact is ever valid."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.common.frame import Frame
from palpate_edge.estimation.uncalibrated import NO_CALIBRATION, UncalibratedEstimator
from palpate_edge.vision.picture_measure import measure_picture, sharpness


def beads(blur_px: float = 0.0, level: int = 120) -> np.ndarray:
    """A picture of 30 dark disks of 16 px in 6 columns, 40 px apart."""
    image = np.full((320, 320), level, np.uint8)
    for x in range(6):
        for y in range(5):
            cv2.circle(image, (60 + 40 * x, 80 + 40 * y), 8, 30, -1, cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), blur_px) if blur_px else image


def test_beads_brightness_and_saturation_are_measured() -> None:
    measure = measure_picture(beads())
    assert measure.blobs == 30
    dark_share = 30 * np.pi * 8.5**2 / 320**2
    assert measure.brightness == pytest.approx(120 - 90 * dark_share, abs=0.5)
    assert measure.saturated_share == 0
    assert measure_picture(beads(level=255)).saturated_share == pytest.approx(1 - dark_share, abs=0.02)


def test_sharpness_falls_with_blur_and_does_not_depend_on_light() -> None:
    assert sharpness(beads()) > sharpness(beads(1.5)) > sharpness(beads(4.0)) > 0
    half = (beads(1.5) // 2).astype(np.uint8)
    assert sharpness(half) == pytest.approx(sharpness(beads(1.5)), rel=0.1)
    assert sharpness(np.full((100, 100), 9, np.uint8)) == 0


def test_no_contact_is_valid_and_the_picture_is_measured_every_two_seconds() -> None:
    estimator = UncalibratedEstimator(30)
    for k in range(62):
        image = beads() if k < 60 else np.zeros((320, 320), np.uint8)
        contact = estimator.estimate(Frame(image, k * 33_333, k, ""))
        assert not contact.valid and not contact.in_contact and contact.reason == NO_CALIBRATION
        assert contact.position_mm is None and contact.normal_force_N is None
        assert (contact.beads_found, contact.beads_expected) == (30 if k < 61 else 0, 30)
    assert estimator.health.refused == estimator.health.frames == 62
    assert estimator.method is None


def test_a_pixel_is_saturated_from_250_on_in_its_brightest_channel() -> None:
    image = np.full((40, 50, 3), 100, np.uint8)
    image[:10, :, 1] = 250
    image[10:20, :, 2] = 249
    assert measure_picture(image).saturated_share == pytest.approx(0.25)


def test_the_sharpness_of_a_ramp_is_its_slope_over_the_contrast() -> None:
    """Over 100 columns grey grows by 2 a pixel; the contrast is that between 2 and 98 % of the pixels."""
    ramp = np.tile(2 * np.arange(100, dtype=np.uint8), (20, 1))
    assert sharpness(ramp) == pytest.approx(2.0 / (0.96 * 198.0), rel=0.02)
    assert sharpness(np.ascontiguousarray(ramp.T)) == pytest.approx(sharpness(ramp))
