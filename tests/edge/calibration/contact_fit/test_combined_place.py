"""Whether a sensor gets contact fields: presses of the dome model on the beads of a sensor, noisy and few."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate_edge.calibration.contact_fit.combined_place import (
    CAUTION_PRESSES,
    best_share,
    fit_combined_place,
)
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.calibration.training.samples import TrainingPress, make_samples
from palpate_edge.calibration.training.typical_contacts import typical_fields
from palpate_edge.calibration.training.uncertainty.confidence_radius import combined_radius
from palpate_edge.estimation.contact_fit.contact_fitter import ContactFitter, FitStart
from palpate_edge.estimation.displacement_field import DisplacementReader, interpolation
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Camera, CameraPose, Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads

RADIUS_MM, DOME_RADIUS_MM = 26.5, 30.0
CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
RINGS = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 24), (75, 24))
NOISE_PX = 0.3
PRESSES, TESTS = 60, 60


class Sensor:
    """A sensor whose presses are those of a dome model with other places, on noisy beads."""

    def __init__(self):
        self.dome = load_dome_model().for_markers(RADIUS_MM)
        beads_mm = bead_layout_mm(Markers(RADIUS_MM, 3.0, tuple(Ring(t, n, 7.0) for t, n in RINGS)))[0]
        view = View(CAMERA, CameraPose())
        self.rest_px = view.project(beads_mm)
        plain = DisplacementReader(self.rest_px, view, RADIUS_MM)
        typical = typical_fields(plain, self.dome.fields[:0], self.dome.fields, smooths_all=True)
        self.reader = DisplacementReader(self.rest_px, view, RADIUS_MM, NOISE_PX, typical)
        self.unit, mm_per_px = self.reader.geometry
        self.px_per_mm = np.linalg.pinv(mm_per_px)

    def press(self, index):
        random = np.random.default_rng(index)
        azimuth_rad = float(random.uniform(0, 2 * np.pi))
        moved_mm = interpolation(self.unit, azimuth_rad) @ self.dome.fields[index]
        moved_px = np.vecdot(self.px_per_mm, moved_mm[:, None])
        seen_px = self.rest_px + moved_px + NOISE_PX * random.standard_normal(moved_px.shape)
        turn = rotation_about_z(azimuth_rad)
        return TrainingPress(
            Beads.from_positions(seen_px, np.ones(85, np.bool_)),
            turn @ self.dome.directions[index],
            turn @ self.dome.forces[index],
            max(1.0, 2.0 / float(np.sqrt((moved_px**2).mean()))),
        )

    def fit(self, presses):
        """Return the regression of the presses and the dome model's other half, and the combined place."""
        half = replace(
            self.dome, fields=self.dome.fields[::2], directions=self.dome.directions[::2],
            forces=self.dome.forces[::2], twisted=None,
        )  # fmt: skip
        regression = fit(make_samples(self.reader, presses, copies=2), half, DOME_RADIUS_MM)
        return regression, fit_combined_place(
            self.reader, NOISE_PX, presses, half, regression, DOME_RADIUS_MM
        )


@pytest.fixture(scope="module")
def sensor():
    return Sensor()


@pytest.fixture(scope="module")
def presses(sensor):
    return [sensor.press(int(index)) for index in np.linspace(1, 2397, PRESSES).astype(int) // 2 * 2 + 1]


@pytest.fixture(scope="module")
def fitted(sensor, presses):
    return sensor.fit(presses)


@pytest.mark.long
def test_on_noisy_beads_the_combined_place_is_nearer_to_presses_that_were_not_learned(sensor, fitted):
    regression, combined = fitted
    assert combined is not None
    fitter = ContactFitter(combined.fields, sensor.reader, NOISE_PX)
    before_mm, after_mm, radius_mm = [], [], []
    for index in np.linspace(100, 2300, TESTS).astype(int) // 2 * 2 + 1:
        press = sensor.press(int(index))
        field = sensor.reader.read(press.beads)
        turn = rotation_about_z(field.azimuth_rad)
        direction, force_N, radius95_mm = regression.predict(field.values[None], np.zeros(1))
        start = FitStart(
            tuple(turn @ direction[0]),
            tuple(turn @ force_N[0]),
            field,
            press.faintness,
        )
        place = fitter.combine(press.beads, start).direction
        before_mm.append(DOME_RADIUS_MM * np.linalg.norm(start.direction - press.direction))
        after_mm.append(DOME_RADIUS_MM * np.linalg.norm(place - press.direction))
        radius_mm.append(fitter.radius_scale * radius95_mm[0] * press.faintness)
    assert np.mean(after_mm) < np.mean(before_mm)
    held = np.mean(np.array(after_mm) <= radius_mm)
    assert held >= 0.95 - 3 * np.sqrt(0.95 * 0.05 * (1 / TESTS + 1 / (PRESSES + 10)))


@pytest.mark.long
def test_the_errors_by_region_are_those_of_the_combined_place(fitted):
    regression, combined = fitted
    assert combined is not None
    assert sum(region.presses for region in combined.regions) == PRESSES

    def mean_mm(regions):
        return sum(region.mean_mm * region.presses for region in regions) / PRESSES

    assert mean_mm(combined.regions) < mean_mm(regression.regions)


@pytest.mark.long
def test_a_few_presses_give_no_contact_fields(sensor, presses):
    _, combined = sensor.fit(presses[:12])
    assert combined is None


def test_the_share_minimises_the_square_error_and_is_cautious_with_few_presses():
    random = np.random.default_rng(5)
    count = 4000
    truth = random.standard_normal((count, 3))
    # Independent errors of deviations 2 and 1: the best share of the second is 4 / (4 + 1).
    given, fitted = (truth + sigma * random.standard_normal((count, 3)) for sigma in (2.0, 1.0))
    assert best_share(given, fitted, truth, np.ones(count)) == pytest.approx(0.8, abs=0.02)
    few = int(CAUTION_PRESSES)
    same = np.tile([[1.0, 0.0, 0.0]], (few, 1))
    assert best_share(same, 0 * same, 0 * same, np.ones(few)) == pytest.approx(0.5)
    assert best_share(same, 2 * same, same - 1, np.ones(few)) == 0.0
    assert best_share(same, same, 0 * same, np.ones(few)) == 0.0


@pytest.mark.long
def test_errors_twice_as_large_have_twice_the_radius(fitted):
    regression, _ = fitted
    assert regression.left_out is not None
    left_out = regression.left_out
    samples, radius = left_out.samples, left_out.radius
    error_mm = DOME_RADIUS_MM * np.linalg.norm(left_out.directions - samples.directions, axis=1)
    scale, held = combined_radius(radius, error_mm, samples, DOME_RADIUS_MM)
    assert scale == pytest.approx(1.0, abs=0.02)
    assert held == pytest.approx(radius.held)
    twice, _ = combined_radius(radius, 2 * error_mm, samples, DOME_RADIUS_MM)
    assert 1.6 < twice < 2.1  # the typical presses added weigh as many as ten
