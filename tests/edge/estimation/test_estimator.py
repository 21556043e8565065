"""The estimator: rejected frames, counters, and the tare."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.common.frame import Frame
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.tare import TARE_FRAMES

PRESS = (0.5, 0.8, 1.8)  # theta_rad, phi_rad, depth_mm


@pytest.fixture
def estimator(drawn_calibration):
    return Estimator(drawn_calibration)


@pytest.fixture(scope="module")
def frame_of(drawn_dome):
    """Draw a frame: ``frame_of(press=(theta, phi, depth), hidden=(...), sequence=...)``."""

    def draw(press=(0.0, 0.0, 0.0), hidden=(), sequence=0):
        image = drawn_dome.picture(drawn_dome.pressed_mm(*press), 77 + sequence, tuple(hidden))
        return Frame(image, 1000 * sequence, sequence, f"{sequence}")

    return draw


def refusal(estimator, image):
    contact = estimator.estimate(Frame(image, 40, 4, "x"))
    assert not contact.valid
    assert not contact.in_contact
    assert contact.position_mm is None
    assert contact.normal_force_N is None
    assert contact.quality == 0
    assert (contact.sequence, contact.exposed_at_us, contact.beads_expected) == (4, 40, 85)
    return contact.reason


def test_frames_of_another_size_are_refused(estimator):
    assert refusal(estimator, np.zeros((240, 330, 3), np.uint8)) == (
        "frame is 330x240, the calibration is for 320x240"
    )


@pytest.mark.parametrize("level", [0, 128, 255])
def test_blank_frames_are_refused(estimator, level):
    assert refusal(estimator, np.full((240, 320, 3), level, np.uint8)) == "frame is blank"


def test_frames_without_any_bead_are_refused(estimator, drawn_dome):
    noise = np.random.default_rng(1).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    half = np.full((240, 320, 3), 30, np.uint8)
    half[:, 160:] = 200
    for image in (noise, half, drawn_dome.picture(drawn_dome.beads_mm(), 1, tuple(range(85)))):
        assert "beads" in refusal(estimator, image)


def test_beads_of_another_dome_are_refused(estimator, another_dome):
    for count in (11, 12, 13):
        rings = ((0, 1, 0), *((15 + 10 * ring, count, 15 * (ring % 2)) for ring in range(7)))
        other = another_dome(rings=rings)
        image = other.picture(other.beads_mm(), seed=count)
        assert "beads" in refusal(estimator, image)


def test_grey_and_colour_give_the_same_contact(estimator, drawn_calibration, frame_of):
    colour = frame_of(PRESS)
    grey = Frame(np.round(colour.image @ np.array([0.114, 0.587, 0.299])).astype(np.uint8), 0, 0, "grey")
    first, second = estimator.estimate(colour), Estimator(drawn_calibration).estimate(grey)
    assert second.position_mm == pytest.approx(first.position_mm, abs=0.1)
    assert second.normal_force_N == pytest.approx(first.normal_force_N, abs=0.05)


def test_hidden_beads_lower_the_quality_and_little_else(estimator, frame_of):
    whole = estimator.estimate(frame_of(PRESS))
    partly = estimator.estimate(frame_of(PRESS, hidden=(2, 50, 70)))
    assert partly.valid
    assert partly.beads_found == 82
    assert partly.quality == pytest.approx(82 / 85)
    assert np.linalg.norm(np.subtract(whole.position_mm, partly.position_mm)) < 6


def test_more_hidden_beads_than_can_be_spared_are_refused(estimator, frame_of):
    contact = estimator.estimate(frame_of(hidden=range(0, 85, 2)))
    assert not contact.valid
    assert contact.reason == "only 42 of 85 beads found"
    assert estimator.estimate(frame_of(PRESS, sequence=1)).beads_found == 85  # and it recovers at once


def test_a_hidden_region_is_refused_and_as_many_scattered_beads_are_not(
    estimator, drawn_calibration, frame_of
):
    places = drawn_calibration.reference().position_px
    region = np.argsort(np.linalg.norm(places - places[40], axis=1))[:20]
    contact = estimator.estimate(frame_of(PRESS, hidden=region.tolist()))
    assert not contact.valid
    assert contact.reason == "all beads of a region are hidden: a contact there could not be detected"
    assert estimator.estimate(frame_of(PRESS, hidden=range(2, 82, 4), sequence=1)).valid


def test_a_frozen_camera_is_refused_until_it_moves_again(estimator, frame_of):
    assert estimator.estimate(frame_of(PRESS)).valid
    for _ in range(2):
        contact = estimator.estimate(frame_of(PRESS))
        assert (contact.valid, contact.quality) == (False, 0.0)
        assert contact.reason == "frame is the same as the one before: the camera is frozen"
    assert estimator.estimate(frame_of(PRESS, sequence=1)).in_contact  # the same press with other noise


def test_health_counts(estimator, frame_of):
    estimator.estimate(frame_of())
    estimator.estimate(frame_of(hidden=(7, 8), sequence=1))
    estimator.estimate(Frame(np.zeros((240, 320), np.uint8), 0, 2, "blank"))
    health = estimator.health
    assert (health.frames, health.refused, health.beads_lost) == (2, 1, 2)


def test_estimates_do_not_depend_on_what_came_before(estimator, drawn_calibration, frame_of):
    for sequence in range(1, 5):
        estimator.estimate(frame_of((0.2 * sequence, -0.5 * sequence, 1.5), sequence=sequence))
    after, fresh = estimator.estimate(frame_of(PRESS)), Estimator(drawn_calibration).estimate(frame_of(PRESS))
    assert after.position_mm == pytest.approx(fresh.position_mm, abs=0.05)
    assert after.normal_force_N == pytest.approx(fresh.normal_force_N, abs=0.02)


def tared(estimator, frame_of, **drawn):
    estimator.tare()
    for sequence in range(100, 100 + TARE_FRAMES):
        contact = estimator.estimate(frame_of(sequence=sequence, **drawn))
        assert not contact.valid
        assert contact.reason == "tare in progress"
    return estimator


def test_the_tare_takes_what_is_there_for_no_contact(estimator, frame_of):
    resting = (0.9, 2.0, 0.8)
    assert estimator.estimate(frame_of(resting)).in_contact
    tared(estimator, frame_of, press=resting)
    contact = estimator.estimate(frame_of(resting, sequence=30))
    assert contact.valid
    assert not contact.in_contact
    assert contact.normal_force_N == 0
    assert estimator.estimate(frame_of(sequence=31)).in_contact  # letting go moves the skin as well


def test_the_tare_ends_although_a_bead_is_hidden(estimator, frame_of):
    tared(estimator, frame_of, hidden=(33,))
    contact = estimator.estimate(frame_of(hidden=(33,), sequence=40))
    assert contact.valid
    assert not contact.in_contact
    assert estimator.estimate(frame_of(PRESS, sequence=41)).in_contact


def test_a_second_tare_replaces_the_first(estimator, frame_of):
    tared(estimator, frame_of, press=PRESS)
    tared(estimator, frame_of)
    assert not estimator.estimate(frame_of(sequence=50)).in_contact
    assert estimator.estimate(frame_of(PRESS, sequence=51)).in_contact


def test_a_contact_cancels_a_tare_that_does_not_accept_it(estimator, frame_of):
    estimator.tare(accepts_contact=False)
    for sequence in range(100, 104):
        assert estimator.estimate(frame_of(sequence=sequence)).reason == "tare in progress"
    for sequence in range(104, 120):
        assert estimator.estimate(frame_of(PRESS, sequence=sequence)).in_contact
    contact = estimator.estimate(frame_of(sequence=120))
    assert contact.valid
    assert not contact.in_contact
