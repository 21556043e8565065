"""Presses on a kitchen scale: weights.csv, and rows of truth.csv with a normal force and no place."""

from __future__ import annotations

import shutil
from functools import partial

import pytest
from tests.edge.datasets.test_press_dataset import refusal, truth

from palpate_edge.datasets.press_dataset import Press, read_dataset, read_truth, read_weights
from palpate_edge.datasets.weights_table import WeightRow, read_weight_rows, weights_text

JIG_HEAD = "frame,mass_g,split,theta_deg,phi_deg"
read_dataset_weights = partial(read_weights, outer_radius_mm=30.0)


def weights(folder, *lines):
    path = folder / "weights.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_grams_are_the_normal_force_of_a_press_without_place(tmp_path):
    rows = read_weights(weights(tmp_path, "frame,mass_g", "a.png,250", "b.png,0"), 30.0)
    assert rows[0] == Press("a.png", "train", 0.0, None, pytest.approx(2.4516625), None, "weight", 0)
    assert rows[1] == Press("b.png", "train", 0.0, None, 0.0, (0.0, 0.0, 0.0), "none", 0, 0.0)
    assert [row.is_weighed for row in rows] == [row.touches for row in rows] == [True, False]


def test_the_split_may_be_given_and_the_text_is_read_as_written(tmp_path):
    rows = [WeightRow("a.png", 120.5, "test"), WeightRow("b.png", 0.0)]
    path = weights(tmp_path, weights_text(rows))
    assert read_weight_rows(path) == rows


def test_a_press_through_a_hole_has_a_place_and_a_force_along_its_axis_alone(tmp_path):
    rows = [WeightRow("a.png", 250.0, "train", 90.0, 270.0), WeightRow("b.png", 250.0)]
    path = weights(tmp_path, weights_text(rows))
    assert read_weight_rows(path) == rows
    hole, apex = read_dataset_weights(path)
    assert hole.position_mm == pytest.approx((0.0, -30.0, 0.0))
    assert (hole.normal_force_N, hole.force_N) == (pytest.approx(2.4516625), None)
    assert apex.position_mm is None
    assert hole.is_weighed and apex.is_weighed and hole.touches and apex.touches


def test_a_row_of_truth_with_a_normal_force_alone_is_a_weighed_press(tmp_path):
    placed = "a.png,train,0,1,2,29,1.25,0.1,0.2,-1.2,plate,0"
    first, weighed, free = read_truth(
        truth(tmp_path, placed, "b.png,train,0,,,,2.5,,,,weight,0", "c.png,train,0,,,,0,0,0,0,none,0")
    )
    assert (weighed.position_mm, weighed.normal_force_N, weighed.force_N) == (None, 2.5, None)
    assert [row.is_weighed for row in (first, weighed, free)] == [False, True, False]
    assert [row.touches for row in (first, weighed, free)] == [True, True, False]


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["frame,grams"], "the first line must be frame,mass_g,split, or that without split"),
        (["frame,mass_g", "a.png,-3"], "line 2: mass_g = -3 is out of range: it must be 0 to 100000"),
        (["frame,mass_g", "a.png,"], 'line 2: mass_g = "" is not a finite number'),
        (["frame,mass_g", "a.png,nan"], 'line 2: mass_g = "nan" is not a finite number'),
        (["frame,mass_g", "../a.png,3"], 'line 2: frame = "../a.png" is not a file name'),
        (["frame,mass_g,split", "a.png,3,trial"], 'line 2: split = "trial" is not one of train, test'),
        (["frame,mass_g", "a.png"], "line 2 has 1 fields, not 2"),
        ([JIG_HEAD, "a.png,3,train,91,0"], "line 2: theta_deg = 91 is out of range: it must be 0 to 90"),
        ([JIG_HEAD, "a.png,3,train,30,361"], "line 2: phi_deg = 361 is out of range: it must be -360 to 360"),
        ([JIG_HEAD, "a.png,3,train,30,"], 'line 2: phi_deg = "" is not a finite number'),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path, lines, said):
    assert said in refusal(read_dataset_weights, weights(tmp_path, *lines))


def test_a_dataset_has_the_presses_of_both_tables(drawn_dataset, tmp_path):
    folder = tmp_path / "d"
    shutil.copytree(drawn_dataset, folder, ignore=shutil.ignore_patterns("frames"))
    before = read_dataset(folder).presses
    weights(folder, "frame,mass_g,split", "w.png,100,train")
    assert read_dataset(folder).presses[:-1] == before
    assert read_dataset(folder).presses[-1].is_weighed
