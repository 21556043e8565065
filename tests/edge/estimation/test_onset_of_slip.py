"""Onset of slip: loads after Cattaneo and Mindlin, loads that are turned back, and recorded presses."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
import pytest

from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.slip_onset import MOST_FRAMES, detect_onset

NORMAL_N, NOISE, REST_S = 2.0, 2e-3, 0.15


def mindlin(way):
    """Tangential force over mu N of a ball on a plane; way: 1 when the last point slides."""
    return 1.0 - (1.0 - min(way, 1.0)) ** 1.5


def contact(at_s, load=0.0, twist=0.0, normal_N=NORMAL_N):
    """load, twist: tangential force and torsion over 3 mm, over the normal force."""
    at_us = round(1e6 * at_s)
    force, place = (load * normal_N, 0.0, -normal_N), (0.0, 0.0, 30.0)
    return Contact(
        at_us, at_us, True, True, place, normal_N, force, 1.0, "", 85, 85, torsion_Nmm=3.0 * twist * normal_N
    )


def flagged(contacts):
    """Return the contacts with a flag."""
    histories = accumulate(contacts, lambda last, one: detect_onset(last[0], one), initial=((), False))
    return [one for one, (_, begins) in zip(contacts, list(histories)[1:], strict=True) if begins]


def detected_s(fps, slips_after_s, friction, phase, seed=0, twists=False):
    """Return when the first frame with a flag was exposed, after slip began; None without a flag."""
    random, contacts = np.random.default_rng(seed), []
    for number in range(round((REST_S + slips_after_s + 0.25) * fps)):
        at_s = (number + phase) / fps
        load = friction * mindlin(max(at_s - REST_S, 0.0) / slips_after_s) + NOISE * random.standard_normal()
        contacts.append(contact(at_s, **{"twist" if twists else "load": load}))
    first = next(iter(flagged(contacts)), None)
    return None if first is None else 1e-6 * first.exposed_at_us - REST_S - slips_after_s


@pytest.mark.parametrize("twists", [False, True])
@pytest.mark.parametrize("friction", [0.3, 0.5, 0.8])
def test_a_quick_slide_is_detected_within_two_or_three_frames(friction, twists):
    """0.02 s until slip is 20 mm/s where a contact slips after 0.4 mm."""
    detected = [detected_s(120.0, 0.02, friction, phase, twists=twists) for phase in np.linspace(0.0, 0.9, 7)]
    assert all(0.0 < one < 3.0 / 120.0 for one in detected)


@pytest.mark.parametrize("slips_after_s", [0.1, 0.2])
def test_a_slow_slide_is_detected_too(slips_after_s):
    detected = [
        detected_s(120.0, slips_after_s, 0.5, phase, seed) for seed, phase in enumerate((0.1, 0.4, 0.8))
    ]
    assert all(0.0 < one < 0.15 for one in detected)


@pytest.mark.parametrize("hz", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("fps", [30.0, 120.0])
def test_shear_that_is_turned_back_is_no_slip(fps, hz):
    random = np.random.default_rng(1)
    loads = [
        0.45 * math.sin(2 * math.pi * hz * n / fps) + NOISE * random.standard_normal()
        for n in range(round(3 * fps))
    ]
    assert not flagged([contact(n / fps, load) for n, load in enumerate(loads)])


def test_a_push_that_is_slowed_down_is_no_slip():
    """The growth of a minimum-jerk motion, here of 0.6 s, ends like the square of the time that is left."""
    ways = [min(n / 72, 1.0) for n in range(120)]
    loads = [0.5 * (10 * way**3 - 15 * way**4 + 6 * way**5) for way in ways]
    assert not flagged([contact(n / 120.0, load) for n, load in enumerate(loads)])


def test_a_grip_that_closes_is_no_slip():
    """The force across the skin stays and the normal force rises: the load falls."""
    grips = [1.0 + min(max(n - 30, 0), 10) / 10 for n in range(60)]
    contacts = [
        contact(n / 120.0, 0.5 * min(n / 20, 1) ** 2 / grip, normal_N=grip) for n, grip in enumerate(grips)
    ]
    assert not flagged(contacts[24:])


def test_only_loads_of_one_contact_are_compared():
    rise = [contact(n / 120.0, 0.1 * n) for n in range(6)]
    still = [contact((n + 6) / 120.0, 0.5) for n in range(6)]
    assert flagged([*rise, *still])
    gone = Contact(9, 45_000, True, False, None, 0.0, (0.0, 0.0, 0.0), 1.0, "", 85, 85)
    for between in (gone, refused_contact(9, 45_000, "blank", 0, 85)):
        assert not flagged([*rise, between, *still])


def test_the_history_stays_short():
    history = ()
    for number in range(3 * MOST_FRAMES):
        history, _ = detect_onset(history, contact(number / 1000.0))
        assert len(history) <= MOST_FRAMES


def test_the_recorded_presses_do_not_begin_to_slip(shared_data, sample_calibration):
    """Plates that press, shear and roll with up to 14 mm/s, 24 s."""
    estimator, false_alarms = Estimator(sample_calibration), []
    for finger in ("finger-1", "finger-2", "finger-3"):
        sequence = read_dataset(shared_data(f"press-sequences/{finger}"))
        for number, press in enumerate(sequence.presses):
            image = read_image(sequence.path(press), grey=True)
            answer = estimator.estimate(Frame(image, round(1e6 * press.time_s), number, ""))
            if answer.slip_begins:
                false_alarms.append((finger, press.frame, press.normal_force_N))
    assert not false_alarms
