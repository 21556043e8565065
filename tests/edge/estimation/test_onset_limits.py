"""The limits of the onset of slip, on loads without noise at 100 frames/s: rest, growth, a corner, rest."""

from __future__ import annotations

import math
from itertools import accumulate

import numpy as np
import pytest

from palpate_edge.common.contact import Contact
from palpate_edge.estimation import slip_onset
from palpate_edge.estimation.slip_onset import detect_onset

FRAME_US = 10_000


def contact(number: int, load: float, normal_N: float = 2.0, torsion_Nmm: float | None = 0.0) -> Contact:
    """A contact at the apex; load: shear over the normal force."""
    force, place = (load * normal_N, 0.0, -normal_N), (0.0, 0.0, 30.0)
    at_us = number * FRAME_US
    return Contact(
        number, at_us, True, True, place, normal_N, force, 1.0, "", 85, 85, torsion_Nmm=torsion_Nmm
    )


def flags(loads, normals_N=None) -> list[int]:
    """The frames that are flagged."""
    normals = [2.0] * len(loads) if normals_N is None else normals_N
    contacts = [contact(n, *pair) for n, pair in enumerate(zip(loads, normals, strict=True))]
    steps = accumulate(contacts, lambda last, one: detect_onset(last[0], one), initial=((), False))
    return [number for number, (_, begins) in enumerate(list(steps)[1:]) if begins]


def corner(last=0.2, before=0.2, start=0.0, rest=10, after=(0.0, 0.0, 0.0)) -> list[float]:
    """Rest at `start`, growth by `before` and then by `last`, and the changes after the corner."""
    top = start + before + last
    return [*[start] * rest, start + before, top, *(top + change for change in after)]


def test_a_corner_is_flagged_one_frame_later() -> None:
    assert flags(corner())[0] == 12


@pytest.mark.parametrize(("before", "is_flagged"), [(2.39 * 0.1, True), (2.41 * 0.1, False)])
def test_a_growth_that_falls_by_more_than_2_4_is_a_motion_that_slows_down(before, is_flagged) -> None:
    assert bool(flags(corner(last=0.1, before=before, after=(0.0,)))) is is_flagged


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("share", "is_flagged"), [(0.079, True), (0.081, False)])
def test_the_load_stands_still_within_a_twelfth_of_its_growth(sign, share, is_flagged) -> None:
    assert bool(flags(corner(after=(sign * share * 0.2,)))) is is_flagged


@pytest.mark.parametrize(("top", "is_flagged"), [(0.249, False), (0.251, True)])
def test_a_load_below_a_quarter_is_no_friction(top, is_flagged) -> None:
    assert bool(flags(corner(last=0.05, before=0.05, start=top - 0.1, after=(0.0,)))) is is_flagged


@pytest.mark.parametrize(("last", "is_flagged"), [(0.0115, False), (0.0125, True)])
def test_a_growth_is_twelve_standard_errors(last, is_flagged) -> None:
    """The least standard error of a load is 0.001; two frames at rest, since the bend is not abrupt."""
    assert bool(flags(corner(last=last, before=last, start=0.4, after=(0.0, 0.0)))) is is_flagged


@pytest.mark.parametrize(("last", "first"), [(0.0151, 12), (0.0149, 13)])
def test_an_abrupt_bend_takes_one_frame_after_the_corner_any_other_two(last, first) -> None:
    """150 /s^2 are 0.015 in a frame of 10 ms."""
    assert flags(corner(last=last, before=last, start=0.4))[0] == first


@pytest.mark.parametrize(("growth", "interval"), [(0.005, 3), (0.0041, 3), (0.0039, 4), (0.002, None)])
def test_a_slow_growth_is_judged_by_the_shortest_interval_that_is_clear(growth, interval) -> None:
    """The corner is frame 19; two intervals later it is sure. Three frames of 0.0041 are 0.0123, above
    twelve standard errors. Six frames of 0.002 are a bend of 3.3 /s^2: less than 8 /s^2 is shear that is
    turned back."""
    loads = [*[0.3] * 10, *(0.3 + growth * (n + 1) for n in range(10))]
    found = flags([*loads, *[loads[-1]] * 15])
    assert found[:1] == ([] if interval is None else [19 + 2 * interval])


@pytest.mark.parametrize(("change", "is_flagged"), [(0.029, True), (-0.029, True), (0.031, False)])
def test_the_normal_force_changes_by_3_percent_at_most(change, is_flagged) -> None:
    loads = corner(after=(0.0,))
    normals = [2.0] * (len(loads) - 1) + [2.0 * (1.0 + change)]
    assert bool(flags(loads, normals)) is is_flagged


@pytest.mark.parametrize(("normal_N", "is_flagged"), [(0.19, False), (0.21, True)])
def test_a_light_contact_has_no_load(normal_N, is_flagged) -> None:
    loads = corner()
    assert bool(flags(loads, [normal_N] * len(loads))) is is_flagged


def test_the_load_is_shear_and_torsion_over_the_normal_force() -> None:
    history, _ = detect_onset((), contact(3, 0.4, normal_N=2.0, torsion_Nmm=1.5))
    (frame,) = history
    np.testing.assert_allclose(frame.load, (0.4, 0.0, 0.0, 1.5 / 3.0 / 2.0), atol=1e-12)
    assert (frame.exposed_at_us, frame.normal_N) == (30_000, 2.0)
    (unknown,), _ = detect_onset((), contact(3, 0.4, torsion_Nmm=None))
    assert unknown.load[3] == 0.0


def test_a_history_has_forty_frames_of_the_last_0_4_s() -> None:
    history = ()
    for number in range(60):
        history, _ = detect_onset(history, contact(number, 0.1))
    assert [frame.exposed_at_us // FRAME_US for frame in history] == list(range(20, 60))
    later, _ = detect_onset(history, contact(75, 0.1))
    assert later[0].exposed_at_us == 350_000 and len(later) == 26
    assert math.isclose(later[-1].load[0], 0.1)


@pytest.mark.parametrize("sigma", [0.004, 0.05])
def test_the_standard_error_of_a_load_is_that_of_white_noise(sigma) -> None:
    """Beside a growth, whose second difference is 0, and a few corners, which a quartile leaves out."""
    random = np.random.default_rng(5)
    along = sigma * random.standard_normal(4000) + np.linspace(0.0, 100.0 * sigma, 4000)
    along[::100] += 20.0 * sigma
    assert slip_onset._noise(along.tolist()) == pytest.approx(sigma, rel=0.15)
    assert slip_onset._noise([0.1 * number for number in range(10)]) == 1e-3
