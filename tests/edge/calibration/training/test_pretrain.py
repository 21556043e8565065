"""`palpate-edge train`: presses of several sensors become those of the first one's size and stiffness."""

from __future__ import annotations

import csv
import shutil

import numpy as np
import pytest

from palpate_edge.calibration.training.pretrain import pretrain
from palpate_edge.common.errors import DatasetError
from palpate_edge.datasets.press_dataset import COLUMNS, TORSION, read_dataset

LENGTHS = ("outer_radius_mm", "wall_mm", "radius_mm", "diameter_mm")


@pytest.fixture(scope="module")
def folder(drawn_dome, tmp_path_factory):
    """A dataset whose torsions are those of the normal force at a lever of its row's number, mm."""
    folder = drawn_dome.write(tmp_path_factory.mktemp("pretrain") / "one", presses=16)
    with (folder / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for number, row in enumerate(rows):
        row[TORSION] = str(number * float(row["fn_N"]))
    write_truth(folder, rows)
    return folder


def write_truth(folder, rows):
    with (folder / "truth.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def scaled_copy(folder, to, length, force):
    """The same pictures, said to be of a dome `length` times as large and forces `force` times as strong."""
    shutil.copytree(folder, to)
    lines = (to / "sensor.toml").read_text().splitlines()
    for number, line in enumerate(lines):
        key, _, value = line.partition(" = ")
        if key in LENGTHS:
            lines[number] = f"{key} = {length * float(value)}"
        elif key == "position_mm":
            lines[number] = f"{key} = {[length * float(x) for x in value.strip('[]').split(',')]}"
    (to / "sensor.toml").write_text("\n".join(lines))
    with (to / "truth.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        for column in COLUMNS[3:10]:
            if row[column]:
                row[column] = str(float(row[column]) * (length if column.endswith("_mm") else force))
        row[TORSION] = str(float(row[TORSION]) * length * force)
    write_truth(to, rows)
    return to


def halves(dome):
    """The samples of the first and of the second of two datasets."""
    half = len(dome.fields) // 2
    return [
        {name: getattr(dome, name)[part] for name in ("fields", "directions", "forces")}
        | {"torsions": dome.twisted.torsions[part]}
        for part in (slice(0, half), slice(half, None))
    ]


@pytest.mark.parametrize(
    ("length", "force"),
    [(1.0, 3.0), *(pytest.param(*one, marks=pytest.mark.slow) for one in [(2.0, 1.0), (0.5, 7.0)])],
)
def test_a_sensor_of_other_size_and_stiffness_teaches_the_same(folder, tmp_path, length, force):
    """Similar bodies look alike to a camera: the very same pictures must become the very same samples."""
    other = scaled_copy(folder, tmp_path / "other", length, force)
    dome = pretrain([folder, other])
    assert dome.markers_radius_mm == 26.5
    first, second = halves(dome)
    size = np.abs(first["fields"]).max()
    assert second["fields"] == pytest.approx(first["fields"], abs=0.01 * size)
    assert second["forces"] == pytest.approx(first["forces"], rel=0.01, abs=1e-3)
    assert second["directions"] == pytest.approx(first["directions"], abs=0.01)
    assert second["torsions"] == pytest.approx(first["torsions"], rel=0.01, abs=1e-3)
    assert np.abs(first["torsions"]).max() > 1


def test_torsions_of_one_dataset_alone_are_left_out(folder, drawn_dome, tmp_path):
    plain = drawn_dome.write(tmp_path / "plain", presses=8)
    assert pretrain([folder]).twisted is not None
    assert pretrain([folder, plain]).twisted is None


def test_forces_are_those_of_the_first_dataset(folder):
    dome = pretrain([folder])
    truth = [press.normal_force_N for press in read_dataset(folder).split("train") if press.position_mm]
    given = np.linalg.norm(dome.forces, axis=1)
    assert given.max() == pytest.approx(max(truth), rel=1e-3)
    assert given.min() == pytest.approx(min(truth), rel=1e-3)


def test_progress_counts_every_picture_once(folder):
    steps = []
    pretrain([folder, folder], lambda *step: steps.append(step))
    total = 2 * (5 + len(read_dataset(folder).split("train")))
    assert steps == [(done, total) for done in range(1, total + 1)]


def test_a_dataset_without_presses_is_named(drawn_dome, folder, tmp_path, one_line):
    empty = drawn_dome.write(tmp_path / "empty")
    with pytest.raises(DatasetError, match="no train press that moves the skin: leave it out") as error:
        pretrain([folder, empty])
    assert str(empty) in one_line(error)
