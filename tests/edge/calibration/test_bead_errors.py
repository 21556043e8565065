"""Errors of single beads' places, found in presses that have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.bead_errors import bead_errors
from palpate_edge.calibration.seen_presses import ERROR_SHARE, seen_by
from palpate_edge.calibration.training.dome_model import DomeModel, load_dome_model
from palpate_edge.calibration.training.samples import TrainingPress
from palpate_edge.common.arrays import Array
from palpate_edge.estimation.displacement_field import DisplacementReader, interpolation
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Camera, Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads

RADIUS_MM = 26.5
RINGS = tuple(Ring(12.0 * ring, 12 if ring else 1, 0.0) for ring in range(8))
OFF = 55  # a bead at 60 deg
OFF_BY = 0.3  # of the displacement
MEASURED_PX = 0.02  # error of all beads


@pytest.fixture(scope="module")
def dome() -> DomeModel:
    return load_dome_model().for_markers(RADIUS_MM)


@pytest.fixture(scope="module")
def sensor() -> tuple[DisplacementReader, View, Array]:
    """Return reader, view and the untouched beads."""
    view = View(Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0)))
    rest_px = view.project(bead_layout_mm(Markers(RADIUS_MM, 3.0, RINGS))[0])
    return DisplacementReader(rest_px, view, RADIUS_MM), view, rest_px


def presses(
    sensor: tuple[DisplacementReader, View, Array], dome: DomeModel, count: int, off_by: float
) -> list[TrainingPress]:
    """Return firm presses of the dome model at all azimuths, in which one bead's place is off."""
    reader, _, rest_px = sensor
    beads, mm_per_px = reader.geometry
    rng, made = np.random.default_rng(1), []
    size_mm = np.linalg.norm(dome.fields, axis=1)
    firm = np.flatnonzero(size_mm > np.median(size_mm))
    for number in rng.choice(firm, count, replace=False):
        turn_rad = float(rng.uniform(0, 2 * np.pi))
        moved_px = np.matvec(np.linalg.pinv(mm_per_px), interpolation(beads, turn_rad) @ dome.fields[number])
        size_px = np.sqrt((moved_px**2).mean())
        place_px = rest_px + moved_px + MEASURED_PX * rng.standard_normal(rest_px.shape)
        place_px[OFF] += off_by * size_px * rng.standard_normal(2)
        found = rng.uniform(size=len(beads)) < 0.99
        found[OFF] = True
        turn = rotation_about_z(turn_rad)
        made.append(
            TrainingPress(
                Beads.from_positions(place_px, found),
                turn @ dome.directions[number],
                turn @ dome.forces[number],
            )
        )
    return made


@pytest.mark.parametrize("count", [20, 100])
def test_a_bead_that_is_off_is_found(
    sensor: tuple[DisplacementReader, View, Array], dome: DomeModel, count: int
) -> None:
    errors = bead_errors(sensor[0], presses(sensor, dome, count, OFF_BY), dome.fields)
    assert int(errors.argmax()) == OFF
    assert errors[OFF] == pytest.approx(OFF_BY, rel=0.4)
    assert np.median(np.delete(errors, OFF)) < OFF_BY / 10


def test_exact_beads_have_small_errors(
    sensor: tuple[DisplacementReader, View, Array], dome: DomeModel
) -> None:
    errors = bead_errors(sensor[0], presses(sensor, dome, 100, 0.0), dome.fields)
    assert np.median(errors) < OFF_BY / 10
    assert errors[OFF] < OFF_BY / 2


def test_the_dome_models_presses_have_the_errors_of_the_own_ones(
    sensor: tuple[DisplacementReader, View, Array], dome: DomeModel
) -> None:
    """Their fields differ from those of exact beads by what a bead that is off makes of a field."""
    reader, view, _ = sensor
    assert dome.solid is not None
    some = slice(0, 120)
    solid = dome.solid
    few = replace(
        dome,
        solid=replace(
            solid,
            motions=solid.motions[some],
            directions=solid.directions[some],
            forces=solid.forces[some],
            torsions=solid.torsions[some],
        ),
    )
    exact = seen_by(reader, view, few)
    change = []
    for off_by in (0.0, OFF_BY):
        seen = seen_by(reader, view, few, presses(sensor, dome, 100, off_by))
        np.testing.assert_array_equal(seen.forces[::2, 2], exact.forces[::2, 2])
        size = np.linalg.norm(exact.fields, axis=1)
        change.append(float(np.mean(np.linalg.norm(seen.fields - exact.fields, axis=1) / size)))
    assert change[1] > 1.3 * change[0], change
    assert change[1] < ERROR_SHARE
