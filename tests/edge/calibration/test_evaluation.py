"""Figures of an evaluation against ones computed by hand, on answers made by hand."""

from __future__ import annotations

import json
import math

import pytest

from palpate_edge.calibration.evaluation import (
    PAPER_ERRORS_MM,
    _Answer,
    _figures,
    evaluate_dataset,
    write_json,
)
from palpate_edge.calibration.evaluation_report import as_table
from palpate_edge.calibration.stopwatch import Stopwatch
from palpate_edge.common.contact import Contact, refused_contact
from palpate_edge.common.errors import CalibrationError, DatasetError
from palpate_edge.datasets.press_dataset import Press
from palpate_edge.estimation.frame_estimator import Method


def above_base(angle_deg, turned_deg=0.0):
    """A point on the sphere of 30 mm so many degrees above the base plane, turned about z."""
    angle, turned = math.radians(angle_deg), math.radians(turned_deg)
    across = 30 * math.cos(angle)
    return (across * math.cos(turned), across * math.sin(turned), 30 * math.sin(angle))


def press(position_mm, force_N=(0.0, 0.0, 0.0)):
    return Press("a.png", "test", 0.0, position_mm, math.hypot(*force_N), force_N, "plate", 0)


def answer(truth, position_mm, force_N=(0.0, 0.0, 0.0), radius95_mm=None):
    """`position_mm` None: no contact seen."""
    normal_N = None if force_N is None else math.hypot(*force_N)
    return _Answer(
        truth,
        Contact(
            1,
            0,
            True,
            position_mm is not None,
            position_mm,
            normal_N,
            force_N,
            1.0,
            "",
            85,
            85,
            radius95_mm=radius95_mm,
        ),
    )


def figures(answers, threshold_N=None):
    return _figures("dome", "test", Method.CORRECTED, answers, Stopwatch(), threshold_N)


def chord_mm(angle_deg):
    return 60 * math.sin(math.radians(angle_deg) / 2)


def test_regions_are_the_papers_bands_of_contact_angle():
    """Region 1 begins at 15 deg and region 5 ends with the pole; below 15 deg is in none of them."""
    angles = (14.9, 15.1, 29.9, 30.1, 44.0, 50.0, 60.1, 61.0, 62.0, 75.1, 89.0, 90.0)
    found = figures([answer(press(above_base(angle)), above_base(angle)) for angle in angles])
    assert [band.count for band in found.regions] == [2, 2, 1, 3, 3]
    assert found.overall.count == len(angles)
    assert len(found.regions) == len(PAPER_ERRORS_MM)


def test_position_errors_are_straight_lines():
    degrees = [1.0, 2.0, 3.0, 10.0]  # moved towards the pole by so much
    found = figures([answer(press(above_base(40)), above_base(40 + off)) for off in degrees]).regions[1]
    chords = sorted(chord_mm(off) for off in degrees)
    assert found.mean_mm == pytest.approx(sum(chords) / 4)
    assert found.median_mm == pytest.approx((chords[1] + chords[2]) / 2)
    assert found.max_mm == pytest.approx(chords[3])
    assert found.p95_mm == pytest.approx(chords[2] + 0.85 * (chords[3] - chords[2]))  # 95 % of 3 steps: 2.85


def test_thirds_of_the_largest_force_hold_every_press_once():
    at = above_base(50)
    answers = [
        answer(press(at, (0.0, 0.0, -force)), at, (0.0, 0.0, -force)) for force in (0.5, 1.0, 2.0, 2.9, 3.0)
    ]
    found = figures(answers)
    assert found.largest_force_N == 3.0
    assert [band.count for band in found.forces] == [1, 1, 3]


def test_force_error_and_direction():
    """Errors (0.3, 0.4) and (0, 0) N: RMSE sqrt(0.25 / 2). Directions: 90 deg off and 0; the press of
    exactly a quarter of the largest force does not count for them."""
    at = above_base(50)
    answers = [
        answer(press(at, (0.0, 0.0, -4.0)), at, (0.3, 0.0, -3.6)),
        answer(press(at, (0.0, 0.0, -2.0)), at, (0.0, 0.0, -2.0)),
    ]
    found = figures(answers).overall
    assert found.force_rmse_N == pytest.approx(math.sqrt(0.125))
    assert found.force_rmse_percent == pytest.approx(100 * math.sqrt(0.125) / 4)
    assert found.direction_deg == pytest.approx(math.degrees(math.atan2(0.3, 3.6)) / 2)
    light = answer(press(at, (0.0, 0.0, -1.0)), at, (-1.0, 0.0, 0.0))
    assert figures([*answers, light]).overall.direction_deg == pytest.approx(found.direction_deg)
    heavier = answer(press(at, (0.0, 0.0, -1.1)), at, (-1.0, 0.0, 0.0))
    assert figures([*answers, heavier]).overall.direction_deg == pytest.approx(
        (2 * found.direction_deg + 90) / 3
    )


def test_unknown_forces_are_not_zero():
    at = above_base(50)
    found = figures([answer(press(at, (0.0, 0.0, -2.0)), at, None)]).overall
    assert (found.force_rmse_N, found.force_rmse_percent, found.direction_deg) == (None, None, None)
    assert found.mean_mm == 0


def test_coverage_counts_errors_within_their_radius():
    radii = [0.6, 0.5, 0.55, None]  # chord of one degree: 0.5236 mm
    answers = [answer(press(above_base(50)), above_base(51), radius95_mm=radius) for radius in radii]
    assert figures(answers).overall.covered_percent == pytest.approx(100 * 2 / 3)
    assert figures(answers[3:]).overall.covered_percent is None


def test_confusion_counts_frames_by_truth_and_answer():
    at, none = above_base(50), None
    light, heavier = press(at, (0.0, 0.0, -0.01)), press(at, (0.0, 0.0, -0.03))
    refused = _Answer(press(at, (0.0, 0.0, -9.0)), refused_contact(1, 0, "frame is blank", 0, 85))
    found = figures(
        [
            *3 * [answer(press(at, (0.0, 0.0, -1.0)), at)],
            answer(light, none),
            answer(heavier, none),
            *4 * [answer(press(none), none)],
            answer(press(none), at),
            *2 * [refused],
        ]
    )
    confusion = found.confusion
    assert (confusion.touch_as_touch, confusion.touch_as_none) == (3, 2)
    assert (confusion.none_as_none, confusion.none_as_touch) == (4, 1)
    assert confusion.lightest_missed_N == pytest.approx(0.01)
    assert confusion.heaviest_missed_N == pytest.approx(0.03)
    assert found.refused == {"frame is blank": 2}
    assert found.frames == 12
    assert found.overall.count == 3  # refused, missed and false ones have no position error
    table = as_table(found)
    assert (
        "contact flag wrong in 3 of 10 frames (30.00 %): 2 touches missed, none above 0.030 N, 1 false"
        in table
    )
    assert "refused: 2 of 12; 2 x frame is blank" in table


def test_touches_below_the_threshold_are_counted_apart():
    """Of two touches below 0.02 N one is missed; of three others one, and of five untouched frames one is
    false: 2 wrong of 8."""
    at, none = above_base(50), None
    touched = [press(at, (0.0, 0.0, -force)) for force in (0.01, 0.019, 0.02, 0.3, 1.0)]
    seen = [answer(truth, at) for truth in touched[1:4]]
    missed = [answer(truth, none) for truth in (touched[0], touched[4])]
    untouched = [*4 * [answer(press(none), none)], answer(press(none), at)]
    found = figures([*seen, *missed, *untouched], threshold_N=0.02)
    assert (found.confusion.wrong, found.confusion.judged) == (2, 8)
    assert (found.confusion.missed_below, found.confusion.touches_below) == (1, 2)
    assert (
        "contact threshold 0.020 N: contact flag wrong in 2 of 8 frames (25.00 %): 1 touches missed, none "
        "above 1.000 N, 1 false\ntouches below it missed: 1 of 2"
    ) in as_table(found)


def test_a_dataset_that_knows_no_forces_has_no_percentage():
    found = figures([answer(press(above_base(80)), above_base(80), (0.0, 0.0, -1.0))])
    assert found.overall.force_rmse_N == 1.0
    assert found.overall.force_rmse_percent is None
    assert sum(band.count for band in found.forces) == 1


def test_an_empty_band_has_no_figures():
    band = figures([answer(press(above_base(80)), above_base(80))]).regions[0]
    assert band.count == 0
    assert band.mean_mm is None
    assert band.covered_percent is None


def test_a_whole_dataset(drawn_dataset, drawn_calibration, drawn_calibration_file, tmp_path):
    """The commands' way, with the paper's method: 15 frames of 60 are of the test split."""
    steps = []
    found = evaluate_dataset(
        drawn_dataset,
        "test",
        drawn_calibration,
        drawn_calibration_file,
        None,
        lambda *step: steps.append(step),
    )
    assert found.method == "paper"
    assert found.frames == 15
    assert steps == [(done, 15) for done in range(1, 16)]
    assert found.refused == {}
    assert sum(band.count for band in found.forces) == found.overall.count
    assert [time.stage for time in found.times] == ["read image", "estimate"]
    assert all(0 < time.median_ms <= time.p99_ms for time in found.times)
    write_json(found, tmp_path / "figures.json")
    read = json.loads((tmp_path / "figures.json").read_text())
    assert read["overall"]["mean_mm"] == found.overall.mean_mm
    assert [band["name"] for band in read["regions"]] == [band.name for band in found.regions]
    assert all(band.name in as_table(found) for band in (*found.regions, *found.forces, found.overall))


def test_refusals(drawn_dataset, another_dome, drawn_calibration, drawn_calibration_file, tmp_path):
    with pytest.raises(DatasetError, match="has no row of the split 'practice'"):
        evaluate_dataset(drawn_dataset, "practice", drawn_calibration, drawn_calibration_file, None)
    other = another_dome(focal_px=200.0).write(tmp_path / "other", presses=4)
    with pytest.raises(CalibrationError, match="was made for sensor"):
        evaluate_dataset(other, "test", drawn_calibration, drawn_calibration_file, None)
    found = figures([answer(press(above_base(80)), above_base(80))])
    with pytest.raises(DatasetError, match="cannot be written"):
        write_json(found, tmp_path)
