"""Motions of a lattice of beads by numpy's least squares, and what a frame with them counts as."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from palpate_edge.estimation.camera_motion import SplitMotion, camera_modes
from palpate_edge.estimation.contact_validation import ContactValidation
from palpate_edge.estimation.drift import Drift
from palpate_edge.estimation.frame_record import FrameRejectedError
from palpate_edge.estimation.image_check import ImageCheck
from palpate_edge.estimation.plausibility import (
    ImplausibleBeadsError,
    check_blind_spot,
    check_doubt,
    check_found,
    check_smooth,
)
from palpate_edge.estimation.skin_motion import SkinMotion, faintness
from palpate_edge.estimation.tare import Tare
from palpate_edge.estimation.touch_classification import SkinState, TouchClassifier
from palpate_edge.vision.beads import Beads, Reference

SPACING_PX = 20.0
PAIRS = [(q, r) for q in range(-3, 4) for r in range(-3, 4) if abs(q + r) <= 3]
REST_PX = 300.0 + SPACING_PX * np.array([(q + 0.5 * r, math.sqrt(0.75) * r) for q, r in PAIRS])
COUNT = len(REST_PX)
REFERENCE = Reference(REST_PX, np.full(COUNT, 8.0), np.full(COUNT, 90.0), np.ones(COUNT))
THRESHOLD_PX = 0.1


def beads(moved_px=0.0, lost=(), noise=None) -> Beads:
    found = np.ones(COUNT, np.bool_)
    found[list(lost)] = False
    given = None if noise is None else np.asarray(noise, np.float32)
    return Beads.from_positions(REST_PX + moved_px, found, noise=given)


def dent(depth_px: float) -> np.ndarray:
    """A press beside the middle: a bump that pushes outwards."""
    from_px = REST_PX - (310.0, 295.0)
    return depth_px * from_px / 20.0 * np.exp(-0.5 * (from_px**2).sum(axis=1) / 25.0**2)[:, None]


def moved_by(amounts) -> np.ndarray:
    return camera_modes(REST_PX) @ np.asarray(amounts, dtype=float)


def test_the_six_motions_of_a_camera() -> None:
    """Shifts, a rotation (no divergence), a zoom (no curl), and two tilts, quadratic in the place."""
    modes = camera_modes(REST_PX)
    centred = REST_PX - REST_PX.mean(axis=0)
    x, y = (centred / np.abs(centred).max()).T
    expected = [(x**0, 0 * x), (0 * x, x**0), (-y, x), (x, y), (x * x, x * y), (x * y, y * y)]
    for number, (along_x, along_y) in enumerate(expected):
        np.testing.assert_allclose(modes[:, :, number], np.column_stack((along_x, along_y)), atol=1e-12)


@pytest.mark.parametrize("lost", [(), (0, 7, 20)])
def test_a_moved_camera_leaves_no_dent(lost) -> None:
    moved = moved_by([1.5, -0.5, 0.3, 0.2, -0.1, 0.15])
    split = SkinMotion(REFERENCE).measure(beads(moved, lost)).split
    np.testing.assert_allclose(split.common_px, moved, atol=1e-9)
    np.testing.assert_allclose(split.dent_px, 0.0, atol=1e-9)


def test_the_common_part_is_the_weighted_least_squares_fit() -> None:
    noise = np.random.default_rng(1).uniform(0.5, 3.0, COUNT)
    moved = moved_by([0.5, 0.2, 0.1, -0.2, 0.0, 0.1]) + dent(1.0)
    seen = beads(moved, lost=(5,), noise=noise)
    weight = np.where(seen.found, 1.0 / noise.astype(np.float32).astype(float) ** 2, 0.0)
    root = np.repeat(np.sqrt(weight), 2)
    flat = camera_modes(REST_PX).reshape(-1, 6)
    amounts = np.linalg.lstsq(flat * root[:, None], moved.ravel() * root, rcond=None)[0]
    split = SkinMotion(REFERENCE).measure(seen).split
    np.testing.assert_allclose(split.common_px, (flat @ amounts).reshape(-1, 2), atol=1e-9)
    np.testing.assert_allclose(split.dent_px[np.arange(COUNT) != 5], (moved - split.common_px)[seen.found])
    assert not split.dent_px[5].any()


def gaussian_means(values: np.ndarray, weight: np.ndarray, length: float, own: bool = True) -> np.ndarray:
    """Means over neighbours by weights of a Gaussian of the distance in spacings, and of each bead."""
    apart = np.linalg.norm(REST_PX[:, None] - REST_PX[None], axis=2) / SPACING_PX
    weights = np.exp(-0.5 * (apart / length) ** 2) * weight
    if not own:
        np.fill_diagonal(weights, 0.0)
    return weights @ values / weights.sum(axis=1, keepdims=True)


def root_mean_square(vectors: np.ndarray) -> float:
    return math.sqrt((vectors**2).sum() / len(vectors))


@pytest.mark.parametrize("lost", [(), (3, 4, 18)])
def test_size_and_roughness_of_a_motion(lost) -> None:
    """Size: of means over two spacings; roughness: from the neighbours' mean over one, in spacings."""
    moved = dent(2.0) + np.random.default_rng(2).normal(0.0, 0.05, (COUNT, 2))
    seen = beads(moved, lost)
    motion = SkinMotion(REFERENCE).measure(seen)
    weight = seen.found.astype(float)
    rough = moved - gaussian_means(moved, weight, 1.0, own=False)
    assert motion.roughness == pytest.approx(root_mean_square(rough[seen.found]) / SPACING_PX, rel=1e-4)
    if not lost:
        assert motion.size_px == pytest.approx(root_mean_square(gaussian_means(moved, weight, 2.0)), rel=1e-4)
        assert motion.noise == 1.0
    np.testing.assert_allclose(motion.displacement_px, moved, atol=1e-12)


def test_a_shift_of_all_beads_has_its_own_size_also_where_beads_are_noisy() -> None:
    shift = np.array([0.3, -0.4])
    assert SkinMotion(REFERENCE).measure(beads(shift)).size_px == pytest.approx(0.5, rel=1e-5)
    noisy = SkinMotion(REFERENCE).measure(beads(shift, lost=(1,), noise=np.full(COUNT, 2.0)))
    assert noisy.size_px == pytest.approx(0.5, rel=1e-5)
    assert noisy.roughness == pytest.approx(0.0, abs=1e-6)
    assert noisy.noise == pytest.approx(2.0, rel=0.05)  # each place is twice as inexact
    none = SkinMotion(REFERENCE).measure(beads(lost=range(COUNT)))
    assert (none.size_px, none.roughness, none.noise, none.dent_size_px) == (0.0, 0.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("over", "factor"), [(37.0, math.sqrt(2.0)), (1e6, 1.0), (0.5, 36_000.0), (1.0, 36_000.0)]
)
def test_faint_motions_are_less_exact_by_36_thresholds(over, factor) -> None:
    assert faintness(over * THRESHOLD_PX, THRESHOLD_PX) == pytest.approx(factor, rel=1e-4)


@pytest.mark.parametrize("lost", [(), (3, 4, 18)])
def test_the_size_of_a_dent_is_of_means_over_1_4_spacings(lost) -> None:
    seen = beads(dent(2.0), lost)
    motion, found = SkinMotion(REFERENCE).measure(seen), seen.found
    means = gaussian_means(motion.split.dent_px, found.astype(float), 1.4)
    assert motion.dent_size_px == pytest.approx(root_mean_square(means[found]), rel=1e-4)


def without(drift: Drift, seen: Beads) -> np.ndarray:
    """Places (n, 2) without the drift."""
    return SkinMotion(REFERENCE).measure(seen, drift.field).position_px


def common(shift_px: float) -> SplitMotion:
    moved = np.tile([shift_px, 0.0], (COUNT, 1))
    return SplitMotion(moved, np.zeros_like(moved))


def test_a_drift_is_followed_at_its_rate_and_compensated() -> None:
    """At once as far as drift can have moved: 0.05 px/s times 20 s, once it has been followed before."""
    drift = Drift(REFERENCE, THRESHOLD_PX)
    assert drift.explains(common(5.9).common_px) and not drift.explains(common(6.1).common_px)
    drift.follow_motion(common(0.0), 0.0, at_once=True)
    drift.elapse(20.0)
    assert drift.explains(common(0.99).common_px) and not drift.explains(common(1.01).common_px)
    drift.follow_motion(common(3.0), 0.03, at_once=True)
    assert drift.total_px == pytest.approx(1.0)
    np.testing.assert_allclose(without(drift, beads((1.0, 0.0))), REST_PX, atol=1e-9)


@pytest.mark.parametrize(
    "motion_px",
    [
        lambda x, y: (2.0 + 0 * x, -1.0 + 0 * y),
        lambda x, y: (-0.02 * y, 0.02 * x),
        lambda x, y: (0.02 * x, 0.02 * y),
        lambda x, y: (3e-4 * x * x, 3e-4 * x * y),
        lambda x, y: (3e-4 * x * y, 3e-4 * y * y),
    ],
    ids=["shift", "rotation", "zoom", "tilt x", "tilt y"],
)
def test_a_press_on_a_moved_camera_is_measured_where_the_skin_is(motion_px) -> None:
    """A zoom of 2 % makes a dent of 10 px larger by 0.2 px; what is left is of second order."""

    def moved(place_px: np.ndarray) -> np.ndarray:
        return np.column_stack(motion_px(*(place_px - REST_PX.mean(axis=0)).T))

    drift = Drift(REFERENCE, THRESHOLD_PX)
    drift.follow_motion(SplitMotion(moved(REST_PX), np.zeros((COUNT, 2))), 0.1, at_once=True)
    np.testing.assert_allclose(without(drift, beads(moved(REST_PX))), REST_PX, atol=1e-9)
    pressed_px = REST_PX + dent(12.0)
    seen = beads(dent(12.0) + moved(pressed_px))
    assert np.abs(dent(12.0)).max() > 7.0
    np.testing.assert_allclose(without(drift, seen), pressed_px, atol=0.03)


def test_a_drift_that_is_not_taken_at_once_is_followed_in_0_2_s_and_goes_6_px_at_most() -> None:
    drift = Drift(REFERENCE, THRESHOLD_PX)
    drift.follow_motion(common(1.0), 0.1, at_once=False)
    assert drift.total_px == pytest.approx(1.0 - math.exp(-0.5))
    far = Drift(REFERENCE, THRESHOLD_PX)
    far.follow_motion(common(10.0), 0.1, at_once=True)
    assert far.total_px == pytest.approx(6.0)


def test_a_dent_is_followed_in_2_s_up_to_one_threshold() -> None:
    drift = Drift(REFERENCE, THRESHOLD_PX)
    still = np.zeros((COUNT, 2))
    small = SplitMotion(still, np.tile([0.05, 0.0], (COUNT, 1)))
    drift.follow_motion(small, 1.0, at_once=False)
    assert drift.total_px == pytest.approx(0.05 * (1.0 - math.exp(-0.5)))
    for _ in range(20):
        drift.follow_motion(small, 1.0, at_once=False)
    assert drift.total_px == pytest.approx(THRESHOLD_PX)


class Skin:
    """Frames of a skin, 30 a second, classified as the estimator does it."""

    def __init__(self) -> None:
        self.drift = Drift(REFERENCE, THRESHOLD_PX)
        self.classifier = TouchClassifier(self.drift, THRESHOLD_PX)
        self.now_us = 0

    def frame(self, moved_px, after_s: float = 1.0 / 30.0) -> SkinState:
        self.now_us += round(1e6 * after_s)
        motion = SkinMotion(REFERENCE).measure(beads(moved_px), self.drift.field)
        return self.classifier.classify(motion, self.now_us)


def test_frames_are_untouched_touched_or_of_a_knocked_camera() -> None:
    skin = Skin()
    assert skin.frame(np.zeros((COUNT, 2))) is SkinState.UNTOUCHED
    assert skin.frame(dent(2.0)) is SkinState.TOUCHED
    assert skin.drift.total_px == 0.0
    assert skin.frame((0.5, 0.0)) is SkinState.KNOCKED  # 5 thresholds in a frame
    assert skin.frame((0.0, 0.0)) is SkinState.UNTOUCHED


def test_a_camera_that_moved_during_a_long_contact_is_drift() -> None:
    skin = Skin()
    skin.frame(np.zeros((COUNT, 2)))
    assert skin.frame(dent(2.0)) is SkinState.TOUCHED
    assert skin.frame(dent(2.0), after_s=30.0) is SkinState.TOUCHED
    assert skin.frame((1.2, 0.0)) is SkinState.UNTOUCHED  # 12 thresholds: followed at once
    assert skin.drift.total_px == pytest.approx(1.2, rel=0.05)
    assert skin.frame((1.2, 0.0)) is SkinState.UNTOUCHED


def test_a_knocked_camera_is_refused_until_the_drift_has_caught_up() -> None:
    skin = Skin()
    for _ in range(3):
        skin.frame(np.zeros((COUNT, 2)))
    states = [skin.frame((0.6, 0.0), after_s=0.5) for _ in range(40)]
    assert states[0] is SkinState.KNOCKED and states[-1] is SkinState.UNTOUCHED
    assert SkinState.TOUCHED not in states


@pytest.mark.parametrize(("found", "expected", "is_refused"), [(59, 100, True), (60, 100, False)])
def test_a_frame_shows_three_fifths_of_the_beads(found, expected, is_refused) -> None:
    if not is_refused:
        check_found(found, expected)
        return
    with pytest.raises(ImplausibleBeadsError, match=f"only {found} of {expected} beads found"):
        check_found(found, expected)


@pytest.mark.parametrize(("check", "limit"), [(check_doubt, 0.03), (check_smooth, 0.12)])
def test_doubt_and_roughness_have_limits(check, limit) -> None:
    check(limit)
    with pytest.raises(ImplausibleBeadsError):
        check(limit + 1e-6)


@pytest.mark.parametrize(
    ("blind_spot", "skin", "radius95_mm", "is_refused"),
    [
        (0.66, SkinState.UNTOUCHED, None, True),
        (0.65, SkinState.UNTOUCHED, None, False),
        (0.66, SkinState.TOUCHED, None, True),
        (0.66, SkinState.TOUCHED, 1.0, False),
    ],
)
def test_a_contact_may_be_in_a_hidden_region_unless_it_is_seen_elsewhere(
    blind_spot, skin, radius95_mm, is_refused
) -> None:
    record = SimpleNamespace(
        hidden=SimpleNamespace(blind_spot=blind_spot),
        skin=skin,
        located=SimpleNamespace(radius95_mm=radius95_mm),
    )
    if not is_refused:
        check_blind_spot(record)
        return
    with pytest.raises(FrameRejectedError, match="all beads of a region are hidden"):
        check_blind_spot(record)


def located(over: float, misfit: float, radius95_mm: float | None = 0.3, skin=SkinState.TOUCHED):
    """A frame whose motion is `over` thresholds."""
    return SimpleNamespace(
        skin=skin,
        motion=SimpleNamespace(size_px=2.0 * over * THRESHOLD_PX, noise=2.0),
        located=SimpleNamespace(misfit=misfit, radius95_mm=radius95_mm),
        radius95_mm=None,
    )


@pytest.fixture
def validation() -> ContactValidation:
    dome = SimpleNamespace(outer_radius_mm=30.0)
    return ContactValidation(
        SimpleNamespace(contact_threshold_px=THRESHOLD_PX, sensor=SimpleNamespace(dome=dome))
    )


def test_the_radius_grows_for_faint_contacts_up_to_the_domes(validation) -> None:
    for over, expected in ((1e6, 0.3), (37.0, 0.3 * math.sqrt(2.0)), (1.001, 30.0)):
        record = located(over, 0.0)
        validation.validate(record)
        assert record.radius95_mm == pytest.approx(expected, rel=1e-4)
    unknown = located(1e6, 0.0, radius95_mm=None)
    validation.validate(unknown)
    assert unknown.radius95_mm is None


@pytest.mark.parametrize(("over", "radius95_mm"), [(1e6, 0.3), (10.0, None), (20.0, 1.0)])
def test_the_misfit_of_a_single_contact_has_a_limit(validation, over, radius95_mm) -> None:
    """0.05, and 8 over the squared motion, and 5 times the squared radius over the dome's."""
    radius_mm = 0.0 if radius95_mm is None else min(radius95_mm * faintness(over, 1.0), 30.0)
    limit = 0.05 + 8.0 / over**2 + 5.0 * (radius_mm / 30.0) ** 2
    validation.validate(located(over, 0.999 * limit, radius95_mm))
    with pytest.raises(FrameRejectedError, match="does not fit a single contact"):
        validation.validate(located(over, 1.001 * limit, radius95_mm))


def test_a_knocked_camera_is_refused_and_an_untouched_skin_is_not(validation) -> None:
    validation.validate(located(1e6, 9.0, skin=SkinState.UNTOUCHED))
    with pytest.raises(FrameRejectedError, match="tare"):
        validation.validate(located(1e6, 0.0, skin=SkinState.KNOCKED))


def test_a_tare_takes_the_mean_of_ten_frames() -> None:
    """A bead that no frame shows keeps its place; one that some show has their mean."""
    done: list[Reference] = []
    tare = Tare(REFERENCE, done.append)
    tare.collect(beads(), is_touched=False)  # not begun
    tare.begin()
    for number in range(10):
        assert done == []
        with pytest.raises(FrameRejectedError, match="tare in progress"):
            tare.collect(beads((0.1 * number, 0.0), lost=(2,) if number < 9 else (1, 2)), is_touched=True)
    (tared,) = done
    moved = tared.position_px - REST_PX
    np.testing.assert_allclose(moved[[0, 1, 2]], [(0.45, 0.0), (0.4, 0.0), (0.0, 0.0)], atol=1e-9)
    tare.collect(beads(), is_touched=False)  # over


def test_a_touch_cancels_a_tare_that_accepts_none() -> None:
    done: list[Reference] = []
    tare = Tare(REFERENCE, done.append)
    tare.begin(accepts_contact=False)
    with pytest.raises(FrameRejectedError):
        tare.collect(beads(), is_touched=False)
    for _ in range(20):
        tare.collect(beads(), is_touched=True)
    assert done == []


def picture(value: int = 0) -> np.ndarray:
    image = np.tile(np.arange(80, dtype=np.uint8), (60, 1))
    image[30, 0] = value
    return image


def test_a_picture_is_of_the_cameras_size_new_and_not_blank() -> None:
    check = ImageCheck((80, 60), "grey")
    check.check_image(picture())
    check.check_image(picture(1))
    with pytest.raises(FrameRejectedError, match="the camera is frozen"):
        check.check_image(picture(1))
    with pytest.raises(FrameRejectedError, match="frame is 60x80, the calibration is for 80x60"):
        check.check_image(picture().T)


@pytest.mark.parametrize(("step", "is_blank"), [(3, True), (4, False)])
def test_a_picture_deviates_by_two_grey_levels_or_is_blank(step: int, is_blank: bool) -> None:
    """Columns of 100 and 100 + step in turn deviate by half of the step."""
    image = np.tile(np.where(np.arange(80) % 2, 100, 100 + step).astype(np.uint8), (60, 1))
    if not is_blank:
        ImageCheck((80, 60), "grey").check_image(image)
        return
    with pytest.raises(FrameRejectedError, match="blank"):
        ImageCheck((80, 60), "grey").check_image(image)
