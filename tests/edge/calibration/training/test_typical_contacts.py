"""Typical fields from canonical fields: turned to all azimuths, and those of a new sensor's contacts."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.calibration.training.typical_contacts import KEPT, typical_fields
from palpate_edge.estimation.displacement_field import (
    DisplacementReader,
    canonical_directions,
    interpolation,
    tangent_basis,
)
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Camera, CameraPose, Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

RADIUS_MM = 26.5
CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
RINGS = ((0, 1), (15, 6), (30, 12), (45, 18), (60, 24), (75, 24))


@pytest.fixture(scope="module")
def reader():
    beads_mm = bead_layout_mm(Markers(RADIUS_MM, 3.0, tuple(Ring(t, n, 7.0) for t, n in RINGS)))[0]
    view = View(CAMERA, CameraPose())
    return DisplacementReader(view.project(beads_mm), view, RADIUS_MM)


def test_interpolation_gives_the_canonical_field_back_at_its_own_directions():
    field = load_dome_model().fields[100]
    turn_rad = 0.7
    places = canonical_directions() @ rotation_about_z(turn_rad).T
    moved = (interpolation(places, turn_rad) @ field) @ rotation_about_z(turn_rad)
    back = np.concatenate([np.vecdot(axis, moved) for axis in tangent_basis(canonical_directions())])
    assert np.linalg.norm(back - field) < 0.02 * np.linalg.norm(field)


def test_typical_fields_are_orthonormal_and_leave_little_of_any_contact(reader):
    dome = load_dome_model()
    taught, other = dome.fields[:1200], dome.fields[1200:]
    typical = typical_fields(reader, np.empty((0, taught.shape[1])), taught, smooths_all=True)
    fields = typical.fields.array().astype(np.float64)
    assert fields.shape == (2 * 85, KEPT)
    assert fields.T @ fields == pytest.approx(np.eye(KEPT), abs=1e-5)
    assert typical.variance.array().sum() + 170 * typical.remainder == pytest.approx(170, rel=0.01)
    beads, mm_per_px = reader.geometry
    left = []
    for number, field in enumerate(other[::20]):
        moved_mm = interpolation(beads, 0.3 * number) @ field
        moved_px = np.vecdot(np.linalg.pinv(mm_per_px), moved_mm[:, None]).ravel()
        rest_px = moved_px - fields @ (moved_px @ fields)
        left.append((rest_px @ rest_px) / (moved_px @ moved_px))
    assert np.mean(left) < 0.02


def test_own_presses_add_their_fields(reader):
    dome = load_dome_model().fields
    own = np.zeros((200, dome.shape[1]))
    own[:, 109 + 50] = 1.0  # a field that no contact of the dome model makes
    beads, mm_per_px = reader.geometry
    strange_px = np.vecdot(np.linalg.pinv(mm_per_px), (interpolation(beads, 0.0) @ own[0])[:, None]).ravel()
    left = []
    for presses in (own[:0], own):
        fields = typical_fields(reader, presses, dome, smooths_all=True).fields.array()
        rest_px = strange_px - fields @ (strange_px @ fields)
        left.append((rest_px @ rest_px) / (strange_px @ strange_px))
    assert left[1] < 0.5 * left[0]


def test_a_faint_contact_on_noisy_beads_is_read_more_exactly(reader):
    dome = load_dome_model().fields
    typical = typical_fields(reader, dome[:0], dome[:1200], smooths_all=True)
    beads, mm_per_px = reader.geometry
    view, random = View(CAMERA, CameraPose()), np.random.default_rng(1)
    rest_px = view.project(beads * RADIUS_MM)
    plain, smoothing = (DisplacementReader(rest_px, view, RADIUS_MM, 0.1, some) for some in (None, typical))
    errors = {plain: [], smoothing: []}
    for number, field in enumerate(dome[1200::40]):
        moved_mm = interpolation(beads, 0.3 * number) @ field
        moved_px = np.vecdot(np.linalg.pinv(mm_per_px), moved_mm[:, None])
        moved_px *= 0.3 / np.sqrt((moved_px**2).mean())
        true = reader.read(Beads.from_positions(rest_px + moved_px, np.ones(85, np.bool_))).values
        seen_px = rest_px + moved_px + 0.1 * random.standard_normal(moved_px.shape)
        for some, found in errors.items():
            values = some.read(Beads.from_positions(seen_px, np.ones(85, np.bool_))).values
            found.append(np.linalg.norm(values - true) / np.linalg.norm(true))
    assert np.median(errors[smoothing]) < 0.9 * np.median(errors[plain])


def test_where_beads_are_exact_typical_fields_only_fill_in_hidden_ones(reader):
    """Contacts of the finite-element library, solved at the beads themselves."""
    library, dome = load_library(), load_dome_model().fields
    typical = typical_fields(reader, dome[:0], dome, smooths_all=False)
    view, random = View(CAMERA, CameraPose()), np.random.default_rng(2)
    beads_mm = reader.geometry[0] * RADIUS_MM
    rest_px = view.project(beads_mm)
    plain, filling = (DisplacementReader(rest_px, view, RADIUS_MM, 0.02, some) for some in (None, typical))
    errors = {plain: [], filling: []}
    for _ in range(40):
        theta_rad, azimuth_rad = random.uniform(0.0, 1.2), random.uniform(0.0, 2 * np.pi)
        depth_mm = random.uniform(0.2, 1.0) * library.largest_depth_mm(theta_rad, Probe.PLATE)
        field = library.field(beads_mm / RADIUS_MM, theta_rad, depth_mm, (0.0, 0.0), azimuth_rad)
        place_px = view.project(beads_mm + field.displacement_mm)
        whole = Beads.from_positions(place_px, np.ones(85, np.bool_))
        true = plain.read(whole).values
        assert (filling.read(whole).values == true).all()
        partly = Beads.from_positions(place_px, random.permutation(85) >= 25)
        for some, found in errors.items():
            found.append(np.linalg.norm(some.read(partly).values - true) / np.linalg.norm(true))
    assert np.mean(errors[filling]) < 0.8 * np.mean(errors[plain])
