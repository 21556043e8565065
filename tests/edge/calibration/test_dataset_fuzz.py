"""Spoiled press datasets, read, calibrated and evaluated: a typed error in one line, or finite numbers."""

from __future__ import annotations

import math
import re
import shutil

import cv2
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.evaluation import evaluate_dataset
from palpate_edge.calibration.evaluation_report import as_table
from palpate_edge.common.errors import PalpateError
from palpate_edge.datasets.press_dataset import read_dataset

FUZZ = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=8)
CELLS = st.sampled_from(["", "0", "-0.0", "1", "-1", "1e-300", "1e300", "-1e308", "30", "nan", "x", "29.9"])
NUMBERS = st.sampled_from(["0", "1", "-1", "2", "10", "100", "1e6", "1e-6", "0.5", "400", "1000"])
COLUMNS = st.integers(2, 11)


@pytest.fixture(scope="module")
def drawn(drawn_dome, tmp_path_factory):
    return drawn_dome.write(tmp_path_factory.mktemp("drawn") / "d", presses=16)


@pytest.fixture
def spoiled(drawn, tmp_path):
    """A copy to spoil, with the rows of its truth.csv."""
    shutil.copytree(drawn, tmp_path / "d", dirs_exist_ok=True)
    header, *rows = (drawn / "truth.csv").read_text().splitlines()
    return tmp_path / "d", header, [row.split(",") for row in rows]


def finite(value):
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, dict):
        return all(finite(one) for one in value.values())
    return all(finite(one) for one in value) if isinstance(value, list | tuple) else True


def run(folder):
    """Calibrate and evaluate: typed errors only, in one line; a calibration has finite numbers."""
    try:
        calibration = calibrate(read_dataset(folder))
        assert finite(msgspec.to_builtins(calibration))
        as_table(evaluate_dataset(folder, "test", calibration, folder / "d.cal", None))
    except PalpateError as error:
        assert "\n" not in str(error)
        assert "nan" not in str(error) or '"nan"' in str(error)


def write(folder, header, rows):
    (folder / "truth.csv").write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n")
    run(folder)


@FUZZ
@given(st.lists(st.tuples(st.integers(0, 15), COLUMNS, CELLS), min_size=1, max_size=5))
@pytest.mark.long
def test_spoiled_cells(spoiled, changes):
    folder, header, rows = spoiled
    rows = [list(row) for row in rows]
    for row, column, cell in changes:
        rows[row][column] = cell
    write(folder, header, rows)


@FUZZ
@given(st.dictionaries(COLUMNS, CELLS, min_size=1, max_size=4))
@pytest.mark.long
def test_spoiled_columns(spoiled, changes):
    folder, header, rows = spoiled
    write(folder, header, [[changes.get(at, cell) for at, cell in enumerate(row)] for row in rows])


@pytest.mark.slow
@FUZZ
@given(st.sets(st.integers(0, 15), max_size=6), st.sampled_from([None, "", "0"]))
@pytest.mark.long
def test_few_rows_with_and_without_forces(spoiled, kept, force):
    folder, header, rows = spoiled
    some = [rows[number] for number in sorted(kept)]
    write(folder, header, some if force is None else [[*row[:6], *4 * [force], *row[10:]] for row in some])


@FUZZ
@given(st.integers(0, 1000), NUMBERS, st.booleans())
@pytest.mark.long
def test_a_spoiled_number_of_the_description(drawn, spoiled, at, number, learned):
    text = (drawn / "sensor.toml").read_text()
    places = list(re.finditer(r"(?<![\w.])-?\d+\.?\d*", text))
    place = places[at % len(places)]
    text = text[: place.start()] + number + text[place.end() :]
    if learned:
        text = text[: text.index("rings")] + text[text.index("[camera]") :]
    (spoiled[0] / "sensor.toml").write_text(text)
    run(spoiled[0])


@pytest.mark.slow
@settings(FUZZ, max_examples=4)
@given(st.integers(0, 2**32), st.sampled_from([0.0, 1.5, 3.0, 8.0]), st.booleans())
@pytest.mark.long
def test_pictures_of_noise_are_no_sensor(drawn, spoiled, seed, sigma_px, learned):
    """Two calibrations of 500 "beads" were saved from such pictures."""
    folder = spoiled[0]
    noise = np.random.default_rng(seed).normal(0, 1, (240, 320))
    if sigma_px:
        noise = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    picture = np.clip(128 + 50 * noise / noise.std(), 0, 255).astype(np.uint8)
    for path in (folder / "reference").iterdir():
        assert cv2.imwrite(str(path), picture)
    text = (drawn / "sensor.toml").read_text()
    if learned:
        text = text[: text.index("rings")] + text[text.index("[camera]") :]
    (folder / "sensor.toml").write_text(text)
    with pytest.raises(PalpateError):
        calibrate(read_dataset(folder))
