"""The guide's steps, driven by rendered pictures on a clock of its own."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.datasets.weights_table import read_weight_rows
from palpate_edge.guide.calibration_report import report_judgement
from palpate_edge.guide.guide_runner import GuideRunner
from palpate_edge.guide.guide_view import GuideStep
from palpate_twin.camera.deformation import ProbePress


class Person:
    """Shows pictures to a guide and answers it; a tenth of a second passes with each picture."""

    def __init__(self, bench, files, now_s=0.0):
        self.bench, self.runner, self.now_s = bench, GuideRunner(files), now_s

    def show(self, *images, period_s=0.1):
        for image in images:
            self.now_s += period_s
            self.runner.frame(image, self.now_s)

    def rest(self, seconds, period_s=0.1):
        count = round(seconds / period_s)
        self.show(*(self.bench.at_rest(n) for n in range(count)), period_s=period_s)

    def next(self):
        self.runner.answer("next")

    def to_presses(self, title="Presses on the scale"):
        """Walk to the presses as a person without trouble does."""
        for _ in range(3):
            self.rest(1.2)
            self.next()
        self.rest(6.0)
        self.next()
        self.rest(0.2)  # the fit to the reference frames
        assert self.title == "Warm-up"
        self.rest(31, period_s=1.0)
        self.next()
        assert self.title == title

    def press(self, number):
        self.take(*self.bench.presses[number])

    def take(self, image, mass_g):
        self.rest(0.1)
        self.show(image)
        self.runner.answer("take")
        self.rest(0.2)  # the hand is gone before the number is typed
        self.runner.answer("mass", mass_g)
        self.rest(0.2)

    @property
    def title(self):
        return self.runner.view.title

    @property
    def verdict(self):
        return self.runner.view.verdict, self.runner.view.text


@pytest.fixture
def person(bench, tmp_path):
    return Person(bench, bench.files(tmp_path / "presses"))


@pytest.mark.slow
def test_from_the_first_picture_to_the_calibration_file(person, bench):
    files = person.runner.files
    assert person.verdict == (Verdict.ABSENT, "no picture yet: see palpate-edge check")
    person.to_presses()
    assert len(list((files.folder / "reference").glob("*.png"))) == 20
    assert person.verdict == (
        Verdict.WARN,
        "without a press the calibration gives positions and no force",
    )
    for number in range(6):
        person.press(number)
    rows = read_weight_rows(files.folder / "weights.csv")
    assert [row.mass_g for row in rows] == [mass_g for _, mass_g in bench.presses[:6]]
    for row, (image, _) in zip(rows, bench.presses, strict=False):
        assert np.array_equal(cv2.imread(str(files.folder / "frames" / row.frame)), image)

    again = Person(bench, files)  # as after a power cut
    again.rest(0.2)
    assert again.title == "Presses on the scale"
    assert (again.runner.view.done, again.runner.view.total) == (6, 12)
    for number in range(6, 12):
        again.press(number)
    assert again.verdict[0] is Verdict.OK
    again.next()
    assert again.title == "Calibration" and not files.calibration.exists()
    again.rest(0.1)
    assert again.title == "Result" and again.runner.is_finished
    assert again.verdict[0] is Verdict.OK
    calibration = load_calibration(files.calibration)
    assert calibration.source.weighed == 12
    assert calibration.stiffness_scale is not None
    assert calibration.source.reference_frames == 20
    assert ("presses", "0 placed, 12 weighed, 0 left out") in again.runner.view.figures
    again.runner.answer("restart")
    assert not again.runner.is_finished and again.title == "Camera and focus"


@pytest.mark.long
def test_what_is_no_press_of_the_apex_is_refused(person, bench):
    person.to_presses()
    person.rest(0.2)
    with pytest.raises(ConfigError, match="no contact: press harder"):
        person.runner.answer("take")
    with pytest.raises(ConfigError, match="mass is not possible now; possible answers: take, next, restart"):
        person.runner.answer("mass", 100)
    image, _ = bench.presses[0]
    person.show(image)
    person.runner.answer("take")
    for mass_g in (0, -3, 1e9):
        with pytest.raises(ConfigError, match="is not a mass of a press"):
            person.runner.answer("mass", mass_g)
    with pytest.raises(ConfigError, match="mass needs a number in g"):
        person.runner.answer("mass")
    person.runner.answer("undo")
    assert "take" in [action.name for action in person.runner.view.actions]
    person.press(0)
    person.runner.answer("undo")
    person.rest(0.1)
    assert read_weight_rows(person.runner.files.folder / "weights.csv") == []
    person.press(1)  # the deleted press's picture is not overwritten
    assert [row.frame for row in read_weight_rows(person.runner.files.folder / "weights.csv")] == ["w-02.png"]


@pytest.mark.long
def test_reference_frames_are_taken_again_after_a_drift_and_kept_at_a_new_start(person, bench):
    for _ in range(3):
        person.rest(1.2)
        person.next()
    person.rest(2.0)
    shifted = [np.roll(image, 1, axis=1) for image in bench.untouched]  # everything moves by one pixel
    person.show(*shifted[:3])
    assert "begun 2 times, since the beads moved" in person.verdict[1]
    assert person.verdict[0] is Verdict.ABSENT
    with pytest.raises(ConfigError, match="of 20 pictures"):
        person.next()
    person.rest(6.0)
    person.next()
    person.rest(0.2)
    person.show(*(shifted[n % len(shifted)] for n in range(32)), period_s=1.0)
    assert person.title == "Warm-up"
    assert dict(person.runner.view.figures)["drift"] not in ("0.00 px", "0.10 px", "0.20 px")
    person.next()
    assert person.title == "Untouched dome"
    person.show(*(shifted[n % len(shifted)] for n in range(60)))
    person.next()
    person.show(shifted[0])
    assert person.title == "Presses on the scale"  # warm already
    folder = person.runner.files.folder
    assert (folder / "reference.1").is_dir()
    person.runner.answer("restart")
    assert person.title == GuideStep.FOCUS.value


def test_focus_finds_the_sharpest_place_again(person, bench):
    image = bench.untouched[0]
    blurred = [cv2.GaussianBlur(image, (0, 0), sigma) for sigma in (4, 2, 0.5, 2, 4)]
    person.show(*blurred)
    assert person.verdict[0] is Verdict.WARN and person.verdict[1].endswith("turn the lens back")
    person.show(blurred[2])
    assert person.verdict == (Verdict.OK, "as sharp as it was at best")


def test_a_camera_of_another_size_is_refused(person):
    person.show(np.full((240, 320, 3), 100, np.uint8))
    assert person.verdict[0] is Verdict.FAIL
    assert person.verdict[1].startswith("the camera gives 320x240, sensor.toml describes 640x480")
    with pytest.raises(ConfigError, match="320x240"):
        person.next()


def test_light_and_missing_beads_have_a_verdict(person, bench):
    image = bench.untouched[0]
    person.show(image)
    person.next()
    with pytest.raises(ConfigError, match="no picture yet"):
        person.next()
    person.show(np.clip(2.5 * image.astype(float), 0, 255).astype(np.uint8))
    assert "% is overexposed: lower capture.camera.exposure_us" in person.verdict[1]
    person.runner.frame(image // 6, person.now_s, 5_000)
    assert person.verdict[1].startswith("the picture is dark: raise capture.camera.exposure_us = ")
    person.next()
    person.show(np.full_like(image, 90))
    assert person.verdict[0] is Verdict.FAIL
    assert "beads of sensor.toml's layout were recognised" in person.verdict[1]
    person.show(image, period_s=1.1)
    assert person.verdict == (Verdict.OK, "every bead of the layout is recognised")
    assert person.runner.view.figures[0] == ("beads", "85 of 85")


def light_touch(bench):
    """Return a picture of a touch that moves few beads."""
    return bench.view.frame(ProbePress(0.8, 0.3, 0.3), np.random.default_rng(5))[0].copy()


def test_reference_pictures_with_a_touch_are_named_and_taken_again(person, bench):
    for _ in range(3):
        person.rest(1.2)
        person.next()
    touch, quiet = light_touch(bench), bench.untouched
    person.show(*(touch if n in (4, 8) else quiet[n % len(quiet)] for n in range(20)), period_s=0.21)
    assert person.verdict == (
        Verdict.ABSENT,
        "18 of 20 pictures; pictures 5, 9 differed from the others and are taken again: the dome was touched",
    )
    person.rest(0.6)
    assert person.verdict[0] is Verdict.WARN
    assert "pictures 5, 9 differed" in person.verdict[1]
    person.next()
    person.rest(0.1)
    names = sorted(path.name for path in (person.runner.files.folder / "reference").glob("*.png"))
    assert len(names) == 20


def test_calibrate_names_reference_frames_with_a_touch(bench, tmp_path):
    folder = tmp_path / "dome"
    bench.files(folder)
    (folder / "reference").mkdir()
    for number in range(8):
        image = light_touch(bench) if number in (2, 5) else bench.at_rest(number)
        cv2.imwrite(str(folder / "reference" / f"{number:03}.png"), image)
    calibration = calibrate(read_dataset(folder), dome=load_dome_model())
    assert calibration.source.touched_references == ("002.png", "005.png")
    judgement = report_judgement(calibration)
    assert judgement.verdict is Verdict.WARN
    assert "2 of 8 reference frames differ from the others (002.png, 005.png)" in judgement.text
