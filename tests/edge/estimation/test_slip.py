"""Slip detection: contacts that travel over the skin, contacts that stick, and recorded presses."""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.slip import SlipDetector

FRAME_US = 33_333


def contact(number, theta_rad, across_N=1.2, normal_N=2.0, radius95_mm=0.3, noise_mm=0.0):
    """A contact at azimuth 0; across_N pulls the skin towards the base."""
    random = np.random.default_rng(number)
    outward = np.array([math.sin(theta_rad), 0.0, math.cos(theta_rad)])
    to_base = np.array([math.cos(theta_rad), 0.0, -math.sin(theta_rad)])
    position = 30 * outward + noise_mm * random.standard_normal(3)
    force = across_N * to_base - normal_N * outward
    place, push = tuple(map(float, position)), tuple(map(float, force))
    return Contact(
        number, number * FRAME_US, True, True, place, normal_N, push, 1.0, "", 85, 85, radius95_mm=radius95_mm
    )


def slips(contacts):
    watch = SlipDetector()
    return [watch.detect(one) for one in contacts]


def test_a_contact_that_travels_with_its_friction_slips():
    """3 mm/s, so 1 mm takes 10 frames; the ends of the window are means of 3 frames."""
    said = slips(contact(number, 0.3 + 0.1 * number / 30) for number in range(40))
    assert not any(said[:10])
    assert all(said[16:])


def test_a_contact_that_travels_against_or_without_friction_rolls():
    for across_N in (-1.2, 0.0, 0.8):
        assert not any(slips(contact(n, 0.3 + 0.1 * n / 30, across_N) for n in range(60)))


def test_a_contact_that_stays_sticks_whatever_the_shear():
    assert not any(slips(contact(n, 0.3, 0.02 * n, noise_mm=0.1) for n in range(200)))


def test_a_place_that_is_not_sure_is_no_travel():
    unsure = [contact(n, 0.3 + 0.1 * n / 30, radius95_mm=2.0) for n in range(30)]
    assert not any(slips(unsure))


def test_another_contact_does_not_go_on_from_the_last():
    first, second = contact(0, 0.3), contact(9, 0.6)
    gone = Contact(8, 8 * FRAME_US, True, False, None, 0.0, (0.0, 0.0, 0.0), 1.0, "", 85, 85)
    refused = refused_contact(8, 8 * FRAME_US, "blank", 0, 85)
    for between in (gone, refused):
        assert not any(slips([*[first] * 5, between, *[second] * 5]))


def test_the_recorded_presses_do_not_slip(shared_data, sample_calibration):
    """Plates that press, shear and roll with up to 14 mm/s, 24 s."""
    estimator = Estimator(sample_calibration)
    false_alarms = []
    for finger in ("finger-1", "finger-2", "finger-3"):
        sequence = read_dataset(shared_data(f"press-sequences/{finger}"))
        for number, press in enumerate(sequence.presses):
            image = read_image(sequence.path(press), grey=True)
            answer = estimator.estimate(Frame(image, round(1e6 * press.time_s), number, ""))
            if answer.slip:
                false_alarms.append((finger, press.frame, press.normal_force_N))
    assert not false_alarms
