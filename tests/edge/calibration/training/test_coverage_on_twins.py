"""The 95 % radius on sensors that were not looked at when its constants were chosen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_twin.camera.random_sensor import random_sensor
from palpate_twin.camera.renderer import CameraView
from palpate_twin.camera.write_dataset import Plan, single_presses, write_dataset
from palpate_twin.dome.library import load_library

SEEDS = (100, 101, 102)  # one of each layout of 85 beads
PRESSES, TESTS = 60, 60

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def answers(tmp_path_factory):
    """(error mm, radius mm, force N) of the test presses of every sensor, by number of own presses."""
    library, dome = load_library(), load_dome_model()
    found = {5: [], 20: [], PRESSES: []}
    for seed in SEEDS:
        folder = tmp_path_factory.mktemp("twin") / str(seed)
        view = CameraView(random_sensor(seed), library)
        write_dataset(folder, view, single_presses(view, Plan(PRESSES, TESTS), 0), 8, 0)
        dataset = read_dataset(folder)
        touches = [press for press in dataset.split("train") if press.position_mm is not None]
        images = [
            (press, read_image(dataset.path(press)))
            for press in dataset.split("test")
            if press.position_mm is not None
        ]
        for count, rows in found.items():
            estimator = Estimator(calibrate(replace(dataset, presses=tuple(touches[:count])), dome=dome))
            for number, (press, image) in enumerate(images):
                contact = estimator.estimate(Frame(image, 33_333 * number, number, press.frame))
                if contact.position_mm is not None:
                    error_mm = np.linalg.norm(np.subtract(contact.position_mm, press.position_mm))
                    rows.append((error_mm, contact.radius95_mm, press.normal_force_N))
    return {count: np.array(rows) for count, rows in found.items()}


@pytest.mark.parametrize("presses", [5, 20, PRESSES])
def test_the_radius_covers_what_it_says(answers, presses):
    """95 %, less three standard deviations: binomial in the counted touches, and as much again for the
    presses (and the prior's ten) that each sensor's quantile comes from."""
    error_mm, radius_mm, _ = answers[presses].T
    assert len(error_mm) > 0.7 * len(SEEDS) * TESTS
    deviation = np.sqrt(0.95 * 0.05 * (1 / len(error_mm) + 1 / (len(SEEDS) * (presses + 10))))
    assert (error_mm <= radius_mm).mean() >= 0.95 - 3 * deviation
    assert np.median(radius_mm) < 6 * np.median(error_mm)  # Rayleigh's error has 2.1, a log-normal one 3


def test_light_touches_are_covered_too(answers):
    """The lightest eighth of all touches together: there are too few on one sensor."""
    error_mm, radius_mm, force_N = np.concatenate([answers[20], answers[PRESSES]]).T
    light = force_N <= np.quantile(force_N, 1 / 8)
    deviation = np.sqrt(0.95 * 0.05 / light.sum())
    assert (error_mm <= radius_mm)[light].mean() >= 0.95 - 3 * deviation
    assert radius_mm[light].mean() > 1.5 * radius_mm[~light].mean()
