"""Training samples: every press with its mirror image, in the canonical frame, turned and partly hidden."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.measurement import measure
from palpate_edge.calibration.training.samples import (
    MAX_HIDDEN,
    MOST_COPIES,
    MOST_SAMPLES,
    REGION_SHARE,
    TrainingPress,
    make_samples,
    training_presses,
)
from palpate_edge.datasets.press_dataset import Press, read_dataset
from palpate_edge.estimation.displacement_field import DisplacementReader, mirrored
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.beads import Beads

PRESSES = ((0.5, 0.4, 1.5), (0.9, -2.0, 0.8), (0.2, 3.0, 2.0))  # theta_rad, phi_rad, depth_mm


def press_at(dome, theta_rad, phi_rad, depth_mm):
    sin = np.sin(theta_rad)
    direction = np.array([sin * np.cos(phi_rad), sin * np.sin(phi_rad), np.cos(theta_rad)])
    at_px = dome.project(dome.pressed_mm(theta_rad, phi_rad, depth_mm))
    found = np.ones(len(at_px), dtype=np.bool_)
    return TrainingPress(Beads.from_positions(at_px, found), direction, -depth_mm * direction, 2.0)


@pytest.fixture(scope="module")
def reader(drawn_dome, drawn_calibration):
    view = View(drawn_calibration.sensor.camera, drawn_calibration.pose)
    return DisplacementReader(drawn_dome.project(drawn_dome.beads_mm()), view, 26.5)


@pytest.fixture(scope="module")
def presses(drawn_dome):
    return [press_at(drawn_dome, *press) for press in PRESSES]


@pytest.fixture(scope="module")
def samples(reader, presses):
    return make_samples(reader, presses, copies=4)


def test_every_copy_has_its_mirror_image(samples):
    even, odd = slice(0, None, 2), slice(1, None, 2)
    flip = np.array([1.0, -1.0, 1.0])
    assert len(samples.fields) == 3 * 4 * 2
    assert (samples.fields[odd] == mirrored(samples.fields[even])).all()
    assert (samples.directions[odd] == samples.directions[even] * flip).all()
    assert (samples.forces_N[odd] == samples.forces_N[even] * flip).all()
    assert samples.press.tolist() == [press for press in range(3) for _ in range(8)]


def test_the_first_copy_is_plain_and_the_others_vary(samples):
    assert samples.plain.tolist() == 3 * [True, True, *6 * [False]]
    assert (samples.hidden[samples.plain] == 0).all()
    assert (samples.faintness == 2.0).all()
    assert 0.1 < samples.hidden.max() < 1.0
    turned_rad = np.arctan2(samples.directions[:, 1], samples.directions[:, 0])
    assert np.ptp(turned_rad[samples.press == 0]) > 0.1
    assert np.abs(turned_rad).max() < 1  # the press lies near the canonical frame's x axis


def test_a_press_is_as_far_from_the_pole_as_it_was_and_as_strong(samples):
    theta = np.array([press[0] for press in PRESSES])[samples.press]
    depth = np.array([press[2] for press in PRESSES])[samples.press]
    assert np.arccos(samples.directions[:, 2]) == pytest.approx(theta)
    assert samples.forces_N == pytest.approx(-depth[:, None] * samples.directions)


def test_every_press_varied_leaves_no_plain_one(reader, presses):
    varied = make_samples(reader, presses, copies=2, varied=np.ones(len(presses), np.bool_))
    assert not varied.plain.any()


def test_no_more_beads_are_hidden_than_stated(drawn_dome, drawn_calibration, presses):
    shares = []

    class Noted(DisplacementReader):
        def read(self, beads, turn_rad=0.0):
            shares.append(1.0 - beads.found.mean())
            return super().read(beads, turn_rad)

    view = View(drawn_calibration.sensor.camera, drawn_calibration.pose)
    make_samples(Noted(drawn_dome.project(drawn_dome.beads_mm()), view, 26.5), presses)
    assert 0.0 < max(shares) <= MAX_HIDDEN


def test_some_copies_hide_a_region_that_is_not_at_the_contact(drawn_dome, drawn_calibration, presses):
    view = View(drawn_calibration.sensor.camera, drawn_calibration.pose)
    hidden = []

    class Noted(DisplacementReader):
        def read(self, beads, turn_rad=0.0):
            hidden.append(~beads.found)
            return super().read(beads, turn_rad)

    reader = Noted(drawn_dome.project(drawn_dome.beads_mm()), view, 26.5)
    make_samples(reader, presses, copies=40, region_share=REGION_SHARE)
    unit = reader.geometry[0]
    at = [press.direction for press in presses for _ in range(40)]
    regions = 0
    for lost, direction in zip(hidden, at, strict=True):
        beads = np.flatnonzero(lost)
        nearest = np.argsort(-unit[beads] @ unit.T, axis=1)[:, : len(beads)]  # to each of them
        if len(beads) >= 5 and any(set(near) == set(beads) for near in nearest):
            regions += 1
            assert (unit[beads] @ direction).max() < np.cos(np.radians(39))
    assert 0.02 * len(hidden) < regions < REGION_SHARE * len(hidden)


def test_one_seed_gives_the_same_samples_and_another_others(reader, presses):
    first, again, other = (make_samples(reader, presses, seed, 3) for seed in (1, 1, 2))
    assert (first.fields == again.fields).all()
    assert not np.array_equal(first.fields, other.fields)


@pytest.mark.parametrize("count", [1, 200, 2000])
def test_copies_stay_within_their_limits(reader, presses, count):
    made = make_samples(reader, (presses * count)[:count])
    copies = len(made.fields) // (2 * count)
    assert 1 <= copies <= MOST_COPIES
    assert copies == 1 or len(made.fields) <= MOST_SAMPLES


def test_rows_without_a_place_are_left_out(presses, drawn_dataset):
    touch = Press("a.png", "train", 0.0, (0.0, 18.0, 24.0), 2.0, (0.1, -1.2, -1.6), "plate", 0)
    none = Press("b.png", "train", 0.0, None, 0.0, (0.0, 0.0, 0.0), "none", 0)
    beads = presses[0].beads
    measured = replace(measure(read_dataset(drawn_dataset), ()), touches=((none, beads), (touch, beads)))
    (found,) = training_presses(measured)
    assert found.direction == pytest.approx([0, 0.6, 0.8])
    assert found.force_N.tolist() == [0.1, -1.2, -1.6]
    assert found.beads is beads
    assert 1 < found.faintness < 36  # FAINT: a press of 1.5 mm moves the skin by many thresholds
