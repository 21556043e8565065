"""The limits of the onset of slip, without noise at 100 frames/s: rest, three steps of growth, a corner."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pytest

from palpate_edge.common.contact import Contact
from palpate_edge.estimation import slip_onset
from palpate_edge.estimation.slip_onset import detect_onset

FRAME_US = 10_000
LOAD = 0.5
LOAD_PER_MM = 4.0
STEPS_MM = (0.02, 0.02, 0.02)


def contact(number: int, load: float, normal_N: float = 2.0, torsion_Nmm: float | None = 0.0) -> Contact:
    """A contact at the apex; load: shear over the normal force."""
    force, place = (load * normal_N, 0.0, -normal_N), (0.0, 0.0, 30.0)
    at_us = number * FRAME_US
    return Contact(
        number, at_us, True, True, place, normal_N, force, 1.0, "", 85, 85, torsion_Nmm=torsion_Nmm
    )


def skin(place_mm: float, aside_mm: float = 0.0) -> tuple[float, float, float, float, float, float]:
    return place_mm, aside_mm, 0.0, 0.0, 0.0, 0.0


def is_flagged(
    steps_mm=STEPS_MM, after_mm=0.0, load=LOAD, growth=None, normal_N=2.0, change=0.0, grown=0.0, aside_mm=0.0
) -> bool:
    """Whether the frame after the corner is flagged.

    load: at the corner, growth: of the load in the last three frames, by default with the skin.
    grown, change: of the normal force, relative, in the three steps and after the corner.
    aside_mm: way of the first step at a right angle to the others.
    """
    places_mm = [*[0.0] * 10, *np.cumsum(steps_mm), sum(steps_mm) + after_mm]
    if growth is None:
        loads = [load + LOAD_PER_MM * min(place - sum(steps_mm), 0.0) for place in places_mm]
    else:
        loads = [*[load - growth] * 11, load - growth / 2, load, load]
    at_corner_N = normal_N * (1.0 + grown)
    normals_N = [*[normal_N] * 10, *np.linspace(normal_N, at_corner_N, 4)[1:], at_corner_N * (1.0 + change)]
    frames = [contact(n, *pair) for n, pair in enumerate(zip(loads, normals_N, strict=True))]
    steps = accumulate(
        zip(frames, map(skin, places_mm, [*[0.0] * 10, *[aside_mm] * 4]), strict=True),
        lambda last, one: detect_onset(last[0], *one),
        initial=((), False),
    )
    flags = [begins for _, begins in steps]
    assert not any(flags[:-1])
    return flags[-1]


def test_a_corner_is_flagged_one_frame_later() -> None:
    assert is_flagged()


@pytest.mark.parametrize(("second_mm", "flagged"), [(0.0141, True), (0.0139, False)])
def test_a_growth_that_gets_quicker_by_more_than_0_7_is_an_abrupt_push(second_mm, flagged) -> None:
    assert is_flagged((second_mm, second_mm, 0.02)) is flagged


@pytest.mark.parametrize(("first_mm", "flagged"), [(0.0141, True), (0.0139, False)])
def test_the_growth_before_is_steady(first_mm, flagged) -> None:
    assert is_flagged((first_mm, 0.02, 0.02)) is flagged


@pytest.mark.parametrize(("aside_mm", "flagged"), [(0.0091, True), (0.0092, False), (-0.0092, False)])
def test_the_way_of_the_first_step_is_1_1_times_its_part_along_the_last_one(aside_mm, flagged) -> None:
    """sqrt(1.1^2 - 1) of 20 um are 9.17."""
    assert is_flagged(aside_mm=aside_mm) is flagged


@pytest.mark.parametrize(("after_mm", "flagged"), [(0.0099, True), (0.0101, False), (-0.0101, False)])
def test_the_skin_moves_by_less_than_half_of_its_speed(after_mm, flagged) -> None:
    assert is_flagged(after_mm=after_mm) is flagged


@pytest.mark.parametrize(("after_mm", "flagged"), [(0.0059, True), (0.0061, False)])
def test_the_skin_moves_by_0_3_less_than_an_even_deceleration_leaves(after_mm, flagged) -> None:
    """Steps of 28, 24 and 20 um go on with 16; less 0.3 of 20 are 10. Of 36, 28 and 20: 12 less 6."""
    assert is_flagged((0.036, 0.028, 0.02), after_mm) is flagged


@pytest.mark.parametrize(("step_mm", "flagged"), [(0.00119, False), (0.00121, True)])
def test_a_motion_is_twelve_standard_errors(step_mm, flagged) -> None:
    """The least standard error of a place is 0.1 um."""
    assert is_flagged((step_mm,) * 3, growth=0.2) is flagged


@pytest.mark.parametrize(("load", "flagged"), [(0.249, False), (0.251, True)])
def test_a_load_below_a_quarter_is_no_friction(load, flagged) -> None:
    assert is_flagged(load=load) is flagged


@pytest.mark.parametrize(("growth", "flagged"), [(0.099, False), (0.101, True)])
def test_the_load_has_grown_by_0_1(growth, flagged) -> None:
    assert is_flagged(growth=growth) is flagged


@pytest.mark.parametrize(
    ("change", "flagged"), [(0.049, True), (-0.049, True), (0.051, False), (-0.051, False)]
)
def test_the_normal_force_changes_by_less_than_5_percent(change, flagged) -> None:
    """The mean of the corner's frame and the next one changes by half of the next one's change."""
    assert is_flagged(change=2.0 * change) is flagged


@pytest.mark.parametrize(
    ("grown", "flagged"), [(0.149, True), (-0.149, True), (0.151, False), (-0.151, False)]
)
def test_the_normal_force_changes_by_15_percent_at_most_while_the_load_grows(grown, flagged) -> None:
    """After the corner it returns to the mean before."""
    assert is_flagged(grown=grown, change=-grown / 2.0) is flagged


@pytest.mark.parametrize(("normal_N", "flagged"), [(0.19, False), (0.21, True)])
def test_a_light_contact_has_no_load(normal_N, flagged) -> None:
    assert is_flagged(normal_N=normal_N) is flagged


def test_the_load_is_shear_and_torsion_over_the_normal_force() -> None:
    history, _ = detect_onset((), contact(3, 0.4, torsion_Nmm=1.5), skin(0.2))
    (frame,) = history
    np.testing.assert_allclose(frame.load, (0.4, 0.0, 0.0, 1.5 / 3.0 / 2.0), atol=1e-12)
    assert (frame.exposed_at_us, frame.normal_N, frame.skin_mm) == (30_000, 2.0, skin(0.2))
    (unknown,), _ = detect_onset((), contact(3, 0.4, torsion_Nmm=None), skin(0.0))
    assert unknown.load[3] == 0.0


def test_a_history_has_forty_frames_of_the_last_0_4_s() -> None:
    history = ()
    for number in range(60):
        history, _ = detect_onset(history, contact(number, 0.1), skin(0.0))
    assert [frame.exposed_at_us // FRAME_US for frame in history] == list(range(20, 60))
    later, _ = detect_onset(history, contact(75, 0.1), skin(0.0))
    assert later[0].exposed_at_us == 350_000 and len(later) == 26


@pytest.mark.parametrize("sigma_mm", [0.0004, 0.05])
def test_the_standard_error_of_a_place_is_that_of_white_noise(sigma_mm) -> None:
    """Beside a motion, whose second difference is 0, and a few corners, which a quartile leaves out."""
    random = np.random.default_rng(5)
    along = sigma_mm * random.standard_normal(4000) + np.linspace(0.0, 100.0 * sigma_mm, 4000)
    along[::100] += 20.0 * sigma_mm
    assert slip_onset._noise(along.tolist()) == pytest.approx(sigma_mm, rel=0.15)
    assert slip_onset._noise([0.1 * number for number in range(10)]) == 1e-4
