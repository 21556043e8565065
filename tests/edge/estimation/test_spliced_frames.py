"""Frames put together of two presses are refused; frames of one press are not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator

OWN_PRESSES = (0, pytest.param(180, marks=pytest.mark.slow))


@pytest.fixture(scope="module")
def sample(shared_data):
    return read_dataset(shared_data("press-sample"))


@pytest.fixture(scope="module", params=OWN_PRESSES)
def calibration(request, sample):
    touches = [press for press in sample.split("train") if press.position_mm is not None]
    chosen = np.random.default_rng(0).permutation(len(touches))[: request.param]
    presses = tuple(touches[number] for number in sorted(chosen))
    return calibrate(replace(sample, presses=presses), dome=load_dome_model())


def splices(sample):
    """Both ways of joining each test press with the next: left | right, top / bottom."""
    presses = [press for press in sample.split("test") if press.position_mm is not None]
    images = [read_image(sample.path(press), grey=True) for press in presses]
    height, width = images[0].shape
    for number, press in enumerate(presses):
        other, image = presses[number - 1], images[number - 1]
        for part in (np.s_[:, width // 2 :], np.s_[height // 2 :]):
            joined = images[number].copy()
            joined[part] = image[part]
            yield joined, press, other


def test_spliced_frames_are_refused(sample, calibration):
    """At most 12 of 108 are accepted; these join presses of nearly the same place."""
    accepted, wrong = 0, 0
    for image, first, second in splices(sample):
        contact = Estimator(calibration).estimate(Frame(image, 0, 0, ""))
        accepted += contact.valid
        if contact.in_contact:
            error_mm = min(math.dist(contact.position_mm, press.position_mm) for press in (first, second))
            wrong += error_mm > 2.5
    assert accepted <= 12
    assert wrong <= 2


def test_frames_of_one_press_are_not(shared_data, calibration):
    refused, frames = 0, 0
    for name in ("press-sample", *(f"press-sequences/finger-{number}" for number in (1, 2, 3))):
        folder = shared_data(name)
        figures = evaluate_dataset(folder, "test", calibration, folder, None)
        refused, frames = refused + sum(figures.refused.values()), frames + figures.frames
    assert frames == 780
    assert refused <= 0.005 * frames
