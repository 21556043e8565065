"""On recordings: the press sample, the press sequences, and frames of a real TacTip."""

from __future__ import annotations

import math

import cv2
import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.recording import all_frames, open_recording
from palpate_edge.estimation.contact_fit.place_stiffness import PlaceStiffness
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.pose.kernel_expansion import Expansion, packed
from palpate_edge.vision.unknown_layout import beads_without_layout


@pytest.fixture(scope="module")
def sample(shared_data):
    return read_dataset(shared_data("press-sample"))


@pytest.fixture(scope="module")
def calibration(sample):
    """The press sample's calibration, for the paper's method."""
    return calibrate(sample)


@pytest.fixture(scope="module")
def estimates(sample, calibration):
    """(press, contact) of each frame of the sample's test split, by the paper's method."""
    estimator = Estimator(calibration)
    return [
        (press, estimator.estimate(Frame(read_image(sample.path(press)), 0, number, press.frame)))
        for number, press in enumerate(sample.split("test"))
    ]


@pytest.mark.long
def test_the_sample_shows_85_beads_close_to_the_layout(calibration):
    assert len(calibration.beads) == 85
    assert not calibration.appearance.bright
    assert calibration.residual_px < 2  # a bead is about 18 px wide
    assert calibration.source.reference_frames == 8
    assert min(bead.contrast for bead in calibration.beads) > 20


def test_the_fitted_camera_is_within_what_assembly_allows(calibration):
    """A camera is up to 1 mm and 2 deg off and its focal length a few per cent (docs/press-dataset.md)."""
    assert math.hypot(*calibration.pose.offset_mm) < 1.5
    assert math.hypot(*calibration.pose.rotation_rad) < math.radians(3)
    assert abs(calibration.pose.focal_scale - 1) < 0.05


def test_every_frame_of_the_sample_is_valid(estimates):
    assert len(estimates) == 60
    assert [contact.reason for _, contact in estimates if not contact.valid] == []


def test_touch_is_told_from_no_touch_on_the_sample(estimates):
    wrong = [
        press.frame for press, contact in estimates if contact.in_contact != (press.position_mm is not None)
    ]
    assert len(wrong) <= 1, wrong


def test_position_and_force_of_the_papers_method(estimates):
    """The paper reports 1.475 mm on its own sensor; as printed the method gives 3-5 mm on this one's kind,
    and 2.1 mm with its fitted correction function."""
    touched = [(p, c) for p, c in estimates if p.position_mm is not None and c.in_contact]
    error_mm = [math.dist(press.position_mm, contact.position_mm) for press, contact in touched]
    error_N = [contact.normal_force_N - press.normal_force_N for press, contact in touched]
    largest_N = max(press.normal_force_N for press, _ in estimates)
    assert np.mean(error_mm) < 3.0
    assert np.sqrt(np.mean(np.square(error_N))) < 0.15 * largest_N


@pytest.mark.parametrize("finger", ["finger-1", "finger-2", "finger-3"])
def test_touch_is_told_in_the_press_sequences(shared_data, calibration, finger):
    folder = shared_data(f"press-sequences/{finger}")
    truth = {press.frame: press for press in read_dataset(folder).presses}
    estimator, right = Estimator(calibration), 0
    frames = list(all_frames(open_recording(folder)))
    for frame in frames:
        contact = estimator.estimate(frame)
        right += contact.valid and contact.in_contact == (truth[frame.name].position_mm is not None)
    assert right >= 0.98 * len(frames)


def test_the_sample_without_its_colours_is_calibrated_alike(sample, calibration, tmp_path):
    (tmp_path / "reference").mkdir()
    for number, path in enumerate(sample.reference):
        cv2.imwrite(str(tmp_path / "reference" / f"{number}.png"), read_image(path, grey=True))
    (tmp_path / "sensor.toml").write_bytes((sample.folder / "sensor.toml").read_bytes())
    grey = calibrate(read_dataset(tmp_path))
    moved = grey.reference().position_px - calibration.reference().position_px
    assert np.linalg.norm(moved, axis=1).max() < 0.15


def test_frames_of_a_real_tactip_are_no_skin_of_ours(shared_data, calibration):
    estimator = Estimator(calibration)
    for frame in all_frames(open_recording(shared_data("real/tactip-raw"))):
        contact = estimator.estimate(frame)
        assert not contact.valid
        assert "beads" in contact.reason


@pytest.mark.parametrize("number", range(5))
def test_127_pins_of_a_real_tactip_are_found_in_each_frame(shared_data, number):
    image = read_image(shared_data("real/tactip-raw") / f"raw_image{number}.png")
    blobs, appearance, diameter_px = beads_without_layout(image)
    assert len(blobs.strength) == 127  # 1 + 6 + 12 + 18 + 24 + 30 + 36, six rings about one
    assert appearance.bright
    assert 6 < diameter_px < 20


def test_the_frame_rate_does_not_make_another_sensor(shared_data, sample):
    sequence = read_dataset(shared_data("press-sequences/finger-1"))
    faster = msgspec.structs.replace(
        sequence.sensor, camera=msgspec.structs.replace(sequence.sensor.camera, fps=120.0)
    )
    assert faster.fingerprint() == sample.sensor.fingerprint()


def test_torn_frames_are_refused(shared_data, sample_calibration, effort):
    """The lower part of each frame moved sideways, as when a camera's transfer loses its place."""
    sample = read_dataset(shared_data("press-sample"))
    estimator = Estimator(sample_calibration)
    presses = [press for press in sample.split("test") if press.normal_force_N > 0.2]
    for number, press in enumerate(presses[: effort(15, len(presses))]):
        whole = read_image(sample.path(press), grey=True)
        torn = whole.copy()
        row, shift = 120 + 7 * number % 240, (8, 40, 200)[number % 3]
        torn[row:] = np.roll(whole[row:], shift, axis=1)
        assert not estimator.estimate(Frame(torn, 0, 2 * number, press.frame)).valid, (
            press.frame,
            row,
            shift,
        )
        assert estimator.estimate(Frame(whole, 0, 2 * number + 1, press.frame)).valid, press.frame


def test_the_stiffness_by_place_changes_forces_alone(shared_data, sample_calibration):
    """A wall that is stiffer towards +x, by one kernel about that side, and pushes presses towards +y."""
    sample = read_dataset(shared_data("press-sample"))
    centre, length, weight = np.array([[1.0, 0.0, 0.0]]), 1.2, 0.4
    expansion = Expansion(*(packed(each) for each in (np.eye(3) / length, np.array([[weight]]), np.zeros(1))))
    to_side = Expansion(*(packed(each) for each in (np.eye(3), np.zeros((1, 3)), np.array([0.0, 0.1, 0.0]))))
    uneven = msgspec.structs.replace(
        sample_calibration, place_stiffness=PlaceStiffness(packed(centre), expansion, to_side)
    )
    even = msgspec.structs.replace(sample_calibration, place_stiffness=msgspec.UNSET)
    before, after = Estimator(even), Estimator(uneven)
    pressed = [press for press in sample.split("test") if press.normal_force_N > 0.2][:10]
    for number, press in enumerate(pressed):
        frame = Frame(read_image(sample.path(press), grey=True), 33_333 * number, number, press.frame)
        one, other = before.estimate(frame), after.estimate(frame)
        assert one.position_mm == other.position_mm and one.force95_N == other.force95_N
        normal = np.array(one.position_mm) / np.linalg.norm(one.position_mm)
        from_centre = normal - centre[0]
        ratio = math.exp(weight * math.exp(-0.5 * float(from_centre @ from_centre) / length**2))
        along = np.array([0.0, 0.1, 0.0]) - 0.1 * normal[1] * normal
        expected_N = ratio * (np.array(one.force_N) + np.linalg.norm(one.force_N) * along)
        np.testing.assert_allclose(other.force_N, expected_N, rtol=1e-5, atol=1e-7)
        assert other.normal_force_N == pytest.approx(ratio * one.normal_force_N, rel=1e-5)
