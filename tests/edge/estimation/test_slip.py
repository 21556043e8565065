"""Slip detection: contacts that travel over the skin, contacts that stick, and recorded presses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

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


def test_rolling_whose_force_reaches_the_limit_in_single_frames_is_no_slip():
    """A ratio of 0.42 with a noise of 3 % in the force: every tenth frame reads 0.48."""
    across_N = [0.96 if number % 10 == 9 else 0.84 for number in range(90)]
    assert not any(slips(contact(n, 0.3 + 0.1 * n / 30, across_N[n]) for n in range(90)))


def test_what_rolled_before_the_load_rose_is_no_slip():
    """1 mm of rolling under a low ratio, 0.1 mm in a ratio of 0.6, then a slide of more than 1 mm."""
    rolled_mm = [min(0.05 * n, 1.0) for n in range(20)]
    loaded_mm = [1.0 + 0.01 * n for n in range(10)]
    slid_mm = [1.1 + 0.15 * n for n in range(12)]
    ratio = [0.3] * 20 + [0.6] * 22
    travel_mm = [*rolled_mm, *loaded_mm, *slid_mm]
    said = slips(contact(n, 0.3 + travel_mm[n] / 30, 2.0 * ratio[n]) for n in range(42))
    assert not any(said[:30])
    assert said[-1]


def test_a_slide_is_flagged_through_frames_whose_force_reads_too_low():
    """3 mm/s under a ratio of 0.6, of which every tenth frame reads 0.3."""
    across_N = [0.6 if number % 10 == 9 else 1.2 for number in range(60)]
    assert all(slips(contact(n, 0.3 + 0.1 * n / 30, across_N[n]) for n in range(60))[20:])


def at_120_fps(contacts):
    return [replace(one, exposed_at_us=one.sequence * 8333) for one in contacts]


def test_a_load_near_the_limit_while_an_object_rolls_is_no_slip():
    """A turn rolls 4 mm in 1 s under a ratio of 0.43, then stands still while the ratio rises to 0.47."""
    rolled_mm = [min(4.0 * n / 120, 4.0) for n in range(180)]
    ratio = [0.43 if n < 120 else 0.47 for n in range(180)]
    contacts = [contact(n, 0.3 + rolled_mm[n] / 30, 2.0 * ratio[n]) for n in range(180)]
    assert not any(slips(at_120_fps(contacts)))


@pytest.mark.parametrize(("pushed_frames", "slides"), [(6, False), (60, True)])
def test_a_push_that_reaches_the_limit_for_50_ms_while_an_object_rolls_is_no_slip(pushed_frames, slides):
    """4 mm/s under a ratio of 0.42 and, while it is pushed, 0.47. In 0.5 s it travels 2 mm."""
    ratio = [0.47 if 120 <= n < 120 + pushed_frames else 0.42 for n in range(240)]
    contacts = [contact(n, 0.3 + 4.0 * n / 120 / 30, 2.0 * ratio[n]) for n in range(240)]
    assert any(slips(at_120_fps(contacts))) is slides


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


@pytest.mark.parametrize(("ratio", "slides"), [(0.44, False), (0.46, True)])
def test_travel_is_slip_from_a_friction_ratio_of_0_45_on(ratio, slides):
    moving = [contact(n, 0.3 + 0.1 * n / 30, across_N=2.0 * ratio) for n in range(40)]
    assert slips(moving)[-1] is slides


@pytest.mark.parametrize(("angle_deg", "slides"), [(59.0, True), (61.0, False)])
def test_travel_is_slip_within_60_deg_of_the_tangential_force(angle_deg, slides):
    """The force turns in the tangential plane; the contact travels towards the base."""
    angle = math.radians(angle_deg)

    def turned(number):
        theta = 0.3 + 0.1 * number / 30
        outward = np.array([math.sin(theta), 0.0, math.cos(theta)])
        to_base = np.array([math.cos(theta), 0.0, -math.sin(theta)])
        across = math.cos(angle) * to_base + math.sin(angle) * np.array([0.0, 1.0, 0.0])
        force = tuple(map(float, 1.2 * across - 2.0 * outward))
        return replace(contact(number, theta), force_N=force)

    assert slips(turned(number) for number in range(40))[-1] is slides


@pytest.mark.parametrize(("radius95_mm", "slides"), [(0.45, True), (0.7, False), (None, False)])
def test_travel_is_more_than_1_mm_and_twice_the_95_percent_radius(radius95_mm, slides):
    """30 mm times 0.04 rad in the means of three frames at either end: 1.2 mm less a tenth."""
    moving = [contact(n, 0.3 + 0.04 * n / 29, radius95_mm=radius95_mm) for n in range(30)]
    assert slips(moving)[-1] is slides


def test_travel_longer_than_a_second_ago_does_not_count():
    moved = [contact(n, 0.3 + 0.1 * min(n, 20) / 30) for n in range(60)]
    said = slips(moved)
    assert said[20]
    assert not said[-1]


def test_no_slip_without_a_push():
    pulled = [contact(n, 0.3 + 0.1 * n / 30, normal_N=-0.5) for n in range(40)]
    assert not any(slips(pulled))
