"""The fit of a contact to noisy beads: contacts of the dome model that the fields have not learned."""

from __future__ import annotations

from itertools import combinations

import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.contact_fit.contact_shapes import dome_shapes
from palpate_edge.calibration.training.dome_model import DomeModel, load_dome_model
from palpate_edge.calibration.training.projection import fit_projection
from palpate_edge.estimation.contact_fit.contact_fields import ContactFields
from palpate_edge.estimation.contact_fit.contact_fitter import ContactFitter, FitStart
from palpate_edge.estimation.displacement_field import DisplacementReader, interpolation
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Camera, CameraPose, Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads

RADIUS_MM = 26.5
CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
RINGS = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 24), (75, 24))
NOISE_PX = 0.1
START_OFF_RAD = 0.08
FAINTNESS = 20.0


@pytest.fixture(scope="module")
def reader():
    beads_mm = bead_layout_mm(Markers(RADIUS_MM, 3.0, tuple(Ring(t, n, 7.0) for t, n in RINGS)))[0]
    view = View(CAMERA, CameraPose())
    return DisplacementReader(view.project(beads_mm), view, RADIUS_MM, NOISE_PX)


@pytest.fixture(scope="module")
def dome():
    return load_dome_model().for_markers(RADIUS_MM)


@pytest.fixture(scope="module")
def fields(dome):
    """Return the contact fields of every second press of the dome model."""
    known = DomeModel(dome.fields[::2], dome.directions[::2], dome.forces[::2], RADIUS_MM)
    projection = fit_projection(known.fields, None, None)
    shapes = dome_shapes(projection, known)
    return ContactFields(
        packed(shapes.centres),
        packed(shapes.weights),
        packed(shapes.offset),
        packed(np.vstack([projection.components.T, projection.mean])),
        share=0.6,
        radius_scale=0.9,
    )


class Touch:
    """One press of the dome model at some azimuth, as the camera sees its beads; the start is off."""

    def __init__(self, reader, dome, press, noise_px):
        random = np.random.default_rng(press)
        azimuth_rad = float(random.uniform(0, 2 * np.pi))
        unit, mm_per_px = reader.geometry
        moved_mm = interpolation(unit, azimuth_rad) @ dome.fields[press]
        moved_px = np.vecdot(np.linalg.pinv(mm_per_px), moved_mm[:, None])
        self.rest_px = View(CAMERA, CameraPose()).project(unit * RADIUS_MM)
        self.seen_px = self.rest_px + moved_px + noise_px * random.standard_normal(moved_px.shape)
        turn = rotation_about_z(azimuth_rad)
        self.direction, force_N = turn @ dome.directions[press], turn @ dome.forces[press]
        off = np.cross(self.direction, random.standard_normal(3))
        start = self.direction + START_OFF_RAD * off / np.linalg.norm(off)
        self.start = FitStart(
            tuple(start / np.linalg.norm(start)),
            tuple(force_N),
            reader.read(self.beads()),
            FAINTNESS,
        )

    def beads(self, found=None):
        return Beads.from_positions(self.seen_px, np.ones(85, np.bool_) if found is None else found)

    def error_rad(self, direction):
        return float(np.linalg.norm(direction - self.direction))


def touches(reader, dome, noise_px):
    return [Touch(reader, dome, press, noise_px) for press in range(1, len(dome.fields), 80)]


def test_the_fit_finds_the_place_of_contacts_that_it_has_not_learned(reader, dome, fields):
    fitter = ContactFitter(fields, reader, NOISE_PX)
    for noise_px in (0.0, NOISE_PX):
        errors = [
            touch.error_rad(fitter.fit(touch.beads(), touch.start).direction)
            for touch in touches(reader, dome, noise_px)
        ]
        assert np.median(errors) < 0.4 * START_OFF_RAD


def test_the_combined_place_is_the_share_of_the_way_to_the_fitted_one(reader, dome, fields):
    fitter = ContactFitter(fields, reader, NOISE_PX)
    touch = Touch(reader, dome, 401, NOISE_PX)
    given = np.array(touch.start.direction)
    fitted = np.array(fitter.fit(touch.beads(), touch.start).direction)
    combined = np.array(fitter.combine(touch.beads(), touch.start).direction)
    assert np.linalg.norm(combined) == pytest.approx(1.0)
    expected = 0.4 * given + 0.6 * fitted
    assert combined == pytest.approx(expected / np.linalg.norm(expected))


def test_the_place_of_a_hidden_bead_counts_for_nothing(reader, dome, fields):
    fitter = ContactFitter(fields, reader, NOISE_PX)
    touch = Touch(reader, dome, 401, NOISE_PX)
    found = np.arange(85) % 7 > 0
    fitted = fitter.fit(touch.beads(found), touch.start).direction
    touch.seen_px = np.where(found[:, None], touch.seen_px, touch.rest_px + 30.0)
    assert fitter.fit(touch.beads(found), touch.start).direction == pytest.approx(fitted, abs=1e-6)


def test_one_contact_fits_and_two_do_not(reader, dome, fields):
    fitter = ContactFitter(fields, reader, NOISE_PX)
    singles = touches(reader, dome, NOISE_PX)
    misfits = [fitter.fit(touch.beads(), touch.start).misfit for touch in singles]
    two = []
    for first, second in combinations(singles, 2):
        if np.dot(first.direction, second.direction) > 0.5:
            continue  # less than 60 deg apart
        seen_px = np.where(first.rest_px[:, :1] < 320.0, first.seen_px, second.seen_px)
        beads = Beads.from_positions(seen_px, np.ones(85, np.bool_))
        two.append(fitter.fit(beads, first.start._replace(field=reader.read(beads))).misfit)
    assert len(two) > 20
    assert np.percentile(misfits, 90) < np.percentile(two, 10)


def test_the_misfit_is_the_distance_of_the_shapes(reader, dome, fields):
    """Beads that nothing moves from the start: the field of the answer is the expansion's at its point."""
    touch = Touch(reader, dome, 401, 0.0)
    misfit = ContactFitter(fields, reader, 1000.0).fit(touch.beads(), touch.start).misfit
    turn, field = rotation_about_z(touch.start.field.azimuth_rad), touch.start.field.values
    place, way = turn.T @ touch.start.direction, turn.T @ touch.start.force_N
    point = np.array(
        [*(2 * place), *(2 * (place + way / np.linalg.norm(way))), 0.3 * np.log(np.linalg.norm(field))]
    )
    kernel = np.exp(-0.5 * ((fields.centres.array() - point) ** 2).sum(axis=1))
    shapes = fields.shapes.array()
    answer = (kernel @ fields.weights.array() + fields.offset.array()) @ shapes[:-1] + shapes[-1]
    away = answer / np.linalg.norm(answer) - field / np.linalg.norm(field)
    assert misfit == pytest.approx(away @ away, abs=1e-3)


def test_beads_of_much_noise_leave_the_place_of_the_correction_model(reader, dome, fields):
    touch = Touch(reader, dome, 401, 0.0)
    fitted = ContactFitter(fields, reader, 1000.0).fit(touch.beads(), touch.start).direction
    assert fitted == pytest.approx(touch.start.direction, abs=1e-3)


def test_a_contact_turned_about_the_axis_moves_the_fit_with_it(reader, dome, fields):
    """The layout has a symmetry of 60 degrees: the beads of each ring take their neighbours' places."""
    fitter = ContactFitter(fields, reader, NOISE_PX)
    touch = Touch(reader, dome, 401, 0.0)
    fitted = np.array(fitter.fit(touch.beads(), touch.start).direction)
    turn = rotation_about_z(np.pi / 3)
    plane = turn[:2, :2]
    centre = np.array([320.0, 240.0])
    to = np.array(
        [
            np.linalg.norm(touch.rest_px - centre - plane @ (place - centre), axis=1).argmin()
            for place in touch.rest_px
        ]
    )
    turned_px = np.empty_like(touch.seen_px)
    turned_px[to] = (touch.seen_px - centre) @ plane.T + centre
    start = touch.start
    again = fitter.fit(
        Beads.from_positions(turned_px, np.ones(85, np.bool_)),
        start._replace(
            direction=tuple(turn @ start.direction),
            force_N=tuple(turn @ start.force_N),
            field=msgspec.structs.replace(start.field, azimuth_rad=start.field.azimuth_rad + np.pi / 3),
        ),
    )
    assert again.direction == pytest.approx(turn @ fitted, abs=2e-3)


def test_an_answer_without_force_or_size_is_fitted_too(reader, dome, fields):
    fitter = ContactFitter(fields, reader, NOISE_PX)
    touch = Touch(reader, dome, 401, NOISE_PX)
    field = touch.start.field
    no_size = msgspec.structs.replace(field, values=np.zeros_like(field.values))
    for start in (touch.start._replace(force_N=(0.0, 0.0, 0.0)), touch.start._replace(field=no_size)):
        assert np.linalg.norm(fitter.fit(touch.beads(), start).direction) == pytest.approx(1.0)
