"""Drift is followed while nothing touches and stands still during a contact."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.drift import MAX_TOTAL_PX, Drift
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.estimation.touch_classification import SkinState, TouchClassifier
from palpate_edge.geometry.sensor import Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads, Reference
from palpate_twin.dome.dome_samples import CAMERA, LAYOUTS
from palpate_twin.dome.library import load_library

THRESHOLD_PX = 0.02
SECOND_US = 1_000_000
NOISE_PX = 0.02


class Watched:
    """A drift fed with beads (n, 2) at times; and its classifier."""

    def __init__(self, reference, period_us=SECOND_US // 10):
        self.reference, self.period_us, self.now_us = reference, period_us, 0
        self.drift = Drift(reference, THRESHOLD_PX)
        self.classifier = TouchClassifier(self.drift, THRESHOLD_PX)
        self.skin = SkinMotion(reference)
        self.random = np.random.default_rng(1)

    def motion_px(self, moved_px):
        beads = Beads.from_positions(self.reference.position_px + moved_px, np.ones(85, dtype=np.bool_))
        return self.skin.measure(beads).size_px

    def see(self, moved_px, noise_px=NOISE_PX / 4):
        self.now_us += self.period_us
        place = self.reference.position_px + moved_px + noise_px * self.random.standard_normal((85, 2))
        beads = Beads.from_positions(place, np.ones(85, dtype=np.bool_))
        return self.classifier.classify(self.skin.measure(beads, self.drift.field), self.now_us)


@pytest.fixture(scope="module")
def reference(drawn_calibration):
    return drawn_calibration.reference()


@pytest.fixture
def watched(reference):
    return Watched(reference)


@pytest.fixture(scope="module")
def dent_px(drawn_dome):
    """Bead motion (85, 2) of a press by plain trigonometry: ``dent_px(theta, phi, depth)``."""

    def motion(theta, phi, depth):
        pressed, rest = drawn_dome.pressed_mm(theta, phi, depth), drawn_dome.beads_mm()
        return drawn_dome.project(pressed) - drawn_dome.project(rest)

    return motion


def moved_camera(drawn_dome, another_dome, amount):
    """Bead motion (85, 2) in px when the camera shifts, turns and zooms; about 3 px for amount 1."""
    x, y, z = drawn_dome.offset_mm
    moved = another_dome(
        offset_mm=(x + 0.5 * amount, y - 0.3 * amount, z),
        tilt_rad=(drawn_dome.tilt_rad[0] + 0.004 * amount, drawn_dome.tilt_rad[1]),
        focal_scale=drawn_dome.focal_scale * (1 + 0.01 * amount),
    )
    return moved.project(drawn_dome.beads_mm()) - drawn_dome.project(drawn_dome.beads_mm())


@pytest.mark.long
def test_a_camera_that_warms_up_is_followed(watched, drawn_dome, another_dome):
    whole = moved_camera(drawn_dome, another_dome, 1.0)
    size_px = np.sqrt((whole**2).sum(axis=1).mean())
    assert 2 < size_px < 5
    seen = {watched.see(whole * math.sin(0.5 * math.pi * t / 1500)) for t in range(1500)}  # 150 s
    assert seen == {SkinState.UNTOUCHED}
    assert watched.drift.total_px == pytest.approx(size_px, rel=0.02)


def test_the_drift_during_a_touch_is_taken_up_at_its_end(watched, drawn_dome, another_dome, dent_px):
    dent, whole = dent_px(0.6, 1.0, 1.0), moved_camera(drawn_dome, another_dome, 1.0)
    watched.see(0 * dent)
    before_px = watched.drift.total_px
    for t in range(600):  # a minute
        assert watched.see(dent + whole * t / 600) is SkinState.TOUCHED
        assert watched.drift.total_px == before_px
    assert watched.see(whole) is SkinState.UNTOUCHED
    assert watched.see(whole + dent_px(0.3, 2.0, 0.3)) is SkinState.TOUCHED


@pytest.mark.parametrize("begin", [0, 30])
def test_one_frame_that_moves_as_one_spoils_no_press_after_it(
    reference, drawn_dome, another_dome, dent_px, begin
):
    """Five thresholds, as a faint touch on the apex makes them, in one frame among presses."""
    watched = Watched(reference)
    faint = moved_camera(drawn_dome, another_dome, 1.0)
    faint *= 5 * THRESHOLD_PX / watched.motion_px(faint)
    for number in range(60):
        if number == begin:
            assert watched.see(faint) is SkinState.UNTOUCHED
        else:
            assert watched.see(dent_px(0.1 * (number % 12), 0.4 * number, 0.5)) is SkinState.TOUCHED
    assert watched.drift.total_px < 0.1 * THRESHOLD_PX


def test_a_camera_that_has_moved_a_little_behind_a_touch_is_followed_after_some_frames(
    watched, drawn_dome, another_dome, dent_px
):
    whole = moved_camera(drawn_dome, another_dome, 1.0)
    whole *= 5 * THRESHOLD_PX / watched.motion_px(whole)
    size_px = np.sqrt((whole**2).sum(axis=1).mean())
    watched.see(0 * whole)
    for _ in range(300):
        watched.see(dent_px(0.6, 1.0, 1.0))
    assert {watched.see(whole) for _ in range(20)} == {SkinState.UNTOUCHED}
    assert watched.drift.total_px == pytest.approx(size_px, rel=0.1)


@pytest.mark.parametrize("theta", [0.0, 0.4, 0.8, 1.2])
@pytest.mark.parametrize("depth", [0.3, 1.0])
def test_an_hour_of_touch_is_not_tared_away(reference, dent_px, theta, depth):
    watched = Watched(reference, period_us=10 * SECOND_US)
    dent = dent_px(theta, 0.7, depth)
    assert watched.see(0 * dent) is SkinState.UNTOUCHED
    before_px = watched.drift.total_px
    assert {watched.see(dent) for _ in range(360)} == {SkinState.TOUCHED}
    assert watched.drift.total_px == before_px


@pytest.mark.parametrize("theta", [0.0, 0.6, 1.2])
def test_a_touch_that_takes_ten_minutes_is_seen_and_kept(watched, dent_px, theta):
    """From nothing to a 1 mm dent in ten minutes: noticed at five thresholds, no more is lost."""
    dent = dent_px(theta, 0.7, 1.0)
    size_px = watched.motion_px(dent)
    said = [watched.see(dent * t / 6000) for t in range(6000)]
    first = said.index(SkinState.TOUCHED)
    assert first / 6000 * size_px < 5 * THRESHOLD_PX  # px of motion before anybody noticed
    assert set(said[first + 200 :]) == {SkinState.TOUCHED}
    assert watched.drift.total_px < 5 * THRESHOLD_PX


def test_no_press_of_the_finite_elements_moves_as_one():
    """The criterion's other side, on fields of the finite elements: 3 layouts, 2 probes."""
    library, view = load_library(), View(CAMERA)
    for rings in LAYOUTS:
        beads_mm = bead_layout_mm(Markers(26.5, 3.0, tuple(Ring(theta, count) for theta, count in rings)))[0]
        rest_px = view.project(beads_mm)
        one = np.ones(len(rest_px))
        for probe in library.probes:
            for theta in np.radians(np.arange(0, 73, 8)):
                reference = Reference(rest_px, 20 * one, one, one)
                classifier = TouchClassifier(Drift(reference, THRESHOLD_PX), THRESHOLD_PX)
                depth_mm = 0.05 * library.largest_depth_mm(theta, probe)
                field = library.field(beads_mm / 26.5, theta, depth_mm, (0.2 * depth_mm, 0.0), 0.3, probe)
                place = view.project(beads_mm + field.displacement_mm)
                beads = Beads.from_positions(place, one > 0)
                motion = SkinMotion(reference).measure(beads)
                assert classifier.classify(motion, 0) is SkinState.TOUCHED, (probe, theta)


def test_a_knock_is_no_contact_and_heals(watched, drawn_dome, another_dome):
    whole = moved_camera(drawn_dome, another_dome, 0.5)
    watched.see(0 * whole)
    said = [watched.see(whole) for _ in range(600)]
    assert said[0] is SkinState.KNOCKED
    assert SkinState.TOUCHED not in said
    assert set(said[-300:]) == {SkinState.UNTOUCHED}


def test_there_is_an_end_to_it(watched):
    far = np.tile([1.5 * MAX_TOTAL_PX, 0.0], (85, 1))
    said = [watched.see(far * t / 3000) for t in range(3000)]
    assert watched.drift.total_px == pytest.approx(MAX_TOTAL_PX, abs=0.1)
    assert said[-1] is SkinState.KNOCKED


def warped(image, amount):
    """The image as a camera sees it that has shifted, turned and zoomed: up to 2 px at the border for 1."""
    height, width = image.shape[:2]
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = columns - width / 2, rows - height / 2
    turn, zoom = 0.003 * amount, 1 + 0.005 * amount
    to_x = width / 2 + (x + turn * y) / zoom - 1.2 * amount
    to_y = height / 2 + (y - turn * x) / zoom + 0.7 * amount
    out = cv2.remap(image, to_x.astype(np.float32), to_y.astype(np.float32), cv2.INTER_CUBIC)
    return np.asarray(np.clip(out * (1 - 0.2 * amount), 0, 255), np.uint8)  # and the light fades


@pytest.mark.parametrize("finger", [pytest.param("finger-1", marks=pytest.mark.slow), "finger-2"])
def test_a_press_after_two_minutes_of_drift_is_as_good_as_before(shared_data, sample_calibration, finger):
    """Recorded frames warped: up to 2 px and 20 % of brightness in the two minutes before the presses."""
    rest = [read_image(path, grey=True) for path in read_dataset(shared_data("press-sample")).reference]
    sequence = read_dataset(shared_data(f"press-sequences/{finger}"))
    touches = [p for p in sequence.presses if p.position_mm is not None]
    from_us = 120 * SECOND_US
    results = {}
    for name, amount_at in (("still", lambda _us: 0.0), ("drifting", lambda us: min(1.0, us / from_us))):
        estimator = Estimator(sample_calibration)
        if name == "drifting":
            for number, now_us in enumerate(range(0, from_us, SECOND_US // 3)):
                frame = Frame(warped(rest[number % len(rest)], amount_at(now_us)), now_us, number, "")
                contact = estimator.estimate(frame)
                assert contact.valid, contact.reason
                assert not contact.in_contact, now_us
        error_mm, error_N, wrong = [], [], 0
        for number, press in enumerate(sequence.presses):
            now_us = from_us + round(1e6 * press.time_s)
            image = warped(read_image(sequence.path(press), grey=True), amount_at(now_us))
            contact = estimator.estimate(Frame(image, now_us, number, ""))
            wrong += not contact.valid or contact.in_contact != (press.position_mm is not None)
            if contact.in_contact and press in touches:
                error_mm.append(math.dist(contact.position_mm, press.position_mm))
                error_N.append(math.dist(contact.force_N, press.force_N))
        results[name] = np.mean(error_mm), np.sqrt(np.mean(np.square(error_N))), wrong
    (still_mm, still_N, still_wrong), (mm, force_N, wrong) = results["still"], results["drifting"]
    assert mm < 1.2 * still_mm
    assert force_N < 1.2 * still_N
    assert wrong <= still_wrong + 1
