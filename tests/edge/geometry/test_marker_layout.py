"""Learned layouts, compared with the places from which the pictures were drawn."""

from __future__ import annotations

import dataclasses
import math

import msgspec
import numpy as np
import pytest

from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.common.errors import CalibrationError
from palpate_edge.common.frame import Frame
from palpate_edge.datasets.images import read_image
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.geometry.marker_layout import learn_layout
from palpate_edge.geometry.sensor import Camera, View
from palpate_edge.vision import registration
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.unknown_layout import beads_without_layout
from palpate_twin.dome.library import load_library
from palpate_twin.dome.probe import Probe

CAMERA = Camera(640, 480, (380.0, 380.0, 320.0, 240.0), (0.0, 0.0, -45.0))
RINGS = {
    "1+6+12+18+24+24": ((0, 1, 0), (15, 6, 0), (30, 12, 15), (45, 18, 0), (60, 24, 7.5), (75, 24, 0)),
    "1+6x14": ((0, 1, 0), *((4.5 + 5.4 * ring, 6, 30 * (ring % 2)) for ring in range(1, 15))),
    "1+7x12": ((0, 1, 0), *((15 + 10 * ring, 12, 15 * (ring % 2)) for ring in range(7))),
    "1+5+11+17+23": ((0, 1, 0), (15, 5, 0), (30, 11, 3), (45, 17, 9), (60, 23, 1)),
    "4+10+16+22": ((8, 4, 0), (22, 10, 3), (37, 16, 9), (52, 22, 1)),
}


def lattice_mm(rings, pitch_deg):
    """A hexagonal lattice of pins wrapped on a sphere of 26.5 mm: distances from the apex are kept."""
    points = []
    for q in range(-rings, rings + 1):
        for r in range(max(-rings, -q - rings), min(rings, rings - q) + 1):
            x, y = q + r / 2, r * math.sqrt(3) / 2
            theta, phi = math.radians(pitch_deg) * math.hypot(x, y), math.atan2(y, x)
            sin = math.sin(theta)
            points.append((sin * math.cos(phi), sin * math.sin(phi), math.cos(theta)))
    return 26.5 * np.array(points)


def shell_sizes(rings):
    return [1, *(6 * ring for ring in range(1, rings + 1))]


@pytest.fixture(scope="module")
def seen(another_dome):
    """Projection of points in F by the drawn camera, which is off by 1 mm and 2 deg."""
    dome = another_dome(width=640, height=480, focal_px=380.0, tilt_rad=(0.02, -0.028))
    return dome.project


def scattered(places_mm, seed=0):
    return places_mm + np.random.default_rng(seed).normal(0, 0.1, places_mm.shape)


@pytest.mark.parametrize("name", RINGS)
@pytest.mark.parametrize("missing", [0, 3])
def test_rings_and_camera_from_pixels_alone(another_dome, seen, name, missing):
    true_mm = scattered(another_dome(rings=RINGS[name]).beads_mm())
    ring_of = np.repeat(np.arange(len(RINGS[name])), [count for _, count, _ in RINGS[name]])
    shown = np.random.default_rng(1).permutation(len(true_mm))[missing:]
    pixels = seen(true_mm[shown])
    layout = learn_layout(CAMERA, 26.5, pixels)
    assert layout.ring_of.tolist() == ring_of[shown][layout.order].tolist()
    placed_mm = View(CAMERA, layout.pose).onto_sphere(pixels, 26.5)
    # focal length 1 % and distance 0.3 mm off look like a slightly wider layout: 0.5 mm at the rim
    assert np.linalg.norm(placed_mm - true_mm[shown], axis=1).max() < 1.1
    nominal_mm = View(CAMERA).onto_sphere(pixels, 26.5)
    assert np.linalg.norm(nominal_mm - true_mm[shown], axis=1).mean() > 1.5  # what the fit took away


@pytest.mark.parametrize(("rings", "pitch_deg"), [(6, 11.0), (10, 7.0)], ids=["127", "331"])
@pytest.mark.parametrize("missing", [0, 4])
def test_shells_of_a_lattice_are_its_rings(seen, rings, pitch_deg, missing):
    true_mm = scattered(lattice_mm(rings, pitch_deg))
    shown = np.random.default_rng(2).permutation(len(true_mm))[missing:]
    pixels = seen(true_mm[shown])
    layout = learn_layout(CAMERA, 26.5, pixels)
    off = np.bincount(layout.ring_of) - np.array(shell_sizes(rings))
    assert off.max() <= 0 and -off.sum() == missing
    placed_mm = View(CAMERA, layout.pose).onto_sphere(pixels, 26.5)
    assert np.linalg.norm(placed_mm - true_mm[shown], axis=1).max() < 1.1


@pytest.mark.parametrize(("rings", "pitch_deg"), [(6, 11.0), (10, 7.0)], ids=["127", "331"])
@pytest.mark.parametrize(
    ("missing", "sizes"),
    [((0,), [0, 6, 12]), ((1, 2, 4, 5), [1, 2, 12]), ((0, 1, 3), [0, 4, 12])],
    ids=["middle", "four-around-it", "middle-and-two"],
)
def test_a_lattice_whose_beads_are_missing_near_the_apex(seen, rings, pitch_deg, missing, sizes):
    """The reflections of the LEDs hide the beads there."""
    lattice = lattice_mm(rings, pitch_deg)
    x, y, z = lattice.T
    hidden = np.lexsort((np.arctan2(y, x), -z.round(6)))[list(missing)]
    layout = learn_layout(CAMERA, 26.5, seen(np.delete(lattice, hidden, axis=0)))
    assert layout.hexagonal
    assert np.bincount(layout.ring_of).tolist() == sizes + shell_sizes(rings)[3:]
    assert layout.pose.rotation_rad[:2] == pytest.approx((0.02, -0.028), abs=0.004)


def test_a_ring_goes_around_by_growing_azimuth_and_the_first_ring_is_innermost(seen):
    layout = learn_layout(CAMERA, 26.5, seen(lattice_mm(6, 11.0)))
    for ring in range(1, 7):
        x, y, _ = layout.position_mm[layout.ring_of == ring].T
        turned = np.diff(np.arctan2(y, x))
        assert (turned > 0).all()
    assert layout.ring_of.tolist() == sorted(layout.ring_of)


@pytest.mark.parametrize("number", range(5))
def test_the_shells_of_a_real_tactip(shared_data, number):
    """A dome of 20 mm seen by a camera of about its field of view: its maker's figures are not known here."""
    blobs, _, _ = beads_without_layout(read_image(shared_data("real/tactip-raw") / f"raw_image{number}.png"))
    camera = Camera(640, 480, (350.0, 350.0, 320.0, 240.0), (0.0, 0.0, -30.0))
    layout = learn_layout(camera, 20.0, blobs.position_px)
    assert np.bincount(layout.ring_of).tolist() == shell_sizes(6)


def test_too_few_beads_and_beads_beside_the_dome_are_refused():
    with pytest.raises(CalibrationError, match=r"only 5 beads .*markers\.rings"):
        learn_layout(CAMERA, 26.5, np.zeros((5, 2)))
    corners = np.array([(x, y) for x in (2.0, 320.0, 638.0) for y in (2.0, 240.0, 478.0)])
    with pytest.raises(CalibrationError, match=r"beside the dome.*camera\.matrix"):
        learn_layout(CAMERA, 26.5, corners)


@pytest.mark.parametrize(
    ("count", "said"), [(60, "make no layout"), (500, "make no layout"), (701, "at most 700")]
)
def test_beads_scattered_at_random_are_no_layout(count, said):
    random = np.random.default_rng(count).uniform((200, 120), (440, 360), (count, 2))
    with pytest.raises(CalibrationError, match=said) as refused:
        learn_layout(CAMERA, 26.5, random)
    assert "markers.rings" in str(refused.value)


@pytest.mark.parametrize(
    ("declared", "said"),
    [
        ({"count": 127}, "85 beads were found in the reference frame, sensor.toml's markers.count is 127"),
        ({"count": 61}, "85 beads were found in the reference frame, sensor.toml's markers.count is 61"),
        ({"layout": "hexagonal"}, "the 85 beads .* make no hexagonal lattice"),
        ({"count": 85, "layout": "any"}, None),
        ({"count": 87}, None),
    ],
)
def test_a_learned_layout_is_compared_with_the_declared_one(drawn_dome, tmp_path, declared, said):
    dataset = without_rings(read_dataset(drawn_dome.write(tmp_path / "d")))
    markers = msgspec.structs.replace(dataset.sensor.markers, **declared)
    dataset = dataclasses.replace(dataset, sensor=msgspec.structs.replace(dataset.sensor, markers=markers))
    if said is None:
        assert len(calibrate(dataset).beads) == 85
        return
    with pytest.raises(CalibrationError, match=said):
        calibrate(dataset)


def test_what_is_not_declared_does_not_change_a_fingerprint(drawn_dome, tmp_path):
    sensor = read_dataset(drawn_dome.write(tmp_path / "d")).sensor
    assert b"count" not in msgspec.json.encode(msgspec.structs.replace(sensor.markers, rings=()))
    declared = msgspec.structs.replace(sensor, markers=msgspec.structs.replace(sensor.markers, count=85))
    assert declared.fingerprint() != sensor.fingerprint()


def without_rings(dataset):
    markers = msgspec.structs.replace(dataset.sensor.markers, rings=())
    return dataclasses.replace(dataset, sensor=msgspec.structs.replace(dataset.sensor, markers=markers))


def positions(calibration, dataset, split, method):
    estimator = Estimator(calibration, method)
    contacts = [
        estimator.estimate(Frame(read_image(dataset.path(press)), 0, number, press.frame))
        for number, press in enumerate(dataset.split(split))
    ]
    assert [contact.reason for contact in contacts if not contact.valid] == []
    return [contact.position_mm for contact in contacts]


def apart_mm(one, other):
    """Distances between the contacts of two estimators, which must agree on what touches."""
    assert [place is None for place in one] == [place is None for place in other]
    return np.array([math.dist(a, b) for a, b in zip(one, other, strict=True) if a is not None])


@pytest.mark.slow
def test_the_sample_without_its_rings_gives_contacts_as_good(shared_data):
    sample = read_dataset(shared_data("press-sample"))
    untrained = dataclasses.replace(sample, presses=sample.split("test"))
    given, learned = (
        calibrate(dataset, dome=load_dome_model()) for dataset in (untrained, without_rings(untrained))
    )
    assert np.bincount(learned.ring_of()).tolist() == [1, 6, 12, 18, 24, 24]
    assert learned.residual_px < 2
    by = [positions(calibration, sample, "test", Method.CORRECTED) for calibration in (given, learned)]
    # the dome model is seen by the camera, whose pose is another one with learned places
    assert apart_mm(*by).mean() < 0.2
    truth = [press.position_mm for press in sample.split("test")]
    of_given, of_learned = (
        np.mean(
            [math.dist(place, true) for place, true in zip(places, truth, strict=True) if place is not None]
        )
        for places in by
    )
    assert of_learned < of_given + 0.05
    by = [positions(calibration, sample, "test", Method.PAPER) for calibration in (given, learned)]
    # its virtual points start at each ring's first bead, and that is another one
    assert apart_mm(*by).mean() < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rings", "pitch_deg", "diameter_mm", "presses"),
    [(6, 11.0, 2.4, 24), (10, 7.2, 1.3, 8)],
    ids=["127", "331"],
)
def test_a_dome_of_pins_is_calibrated_and_estimated(
    another_dome, tmp_path, rings, pitch_deg, diameter_mm, presses
):
    fields = load_library()  # presses of a dome solved by finite elements

    class Pins(another_dome().__class__):
        def beads_mm(self):
            return lattice_mm(rings, pitch_deg)

        def pressed_mm(self, theta_rad, phi_rad, depth_mm):
            beads, depth_mm = self.beads_mm(), min(depth_mm, fields.largest_depth_mm(theta_rad, Probe.PLATE))
            if depth_mm == 0:
                return beads
            return (
                beads + fields.field(beads / 26.5, theta_rad, depth_mm, azimuth_rad=phi_rad).displacement_mm
            )

        def _sizes_px(self, beads_mm):
            return super()._sizes_px(beads_mm) * diameter_mm / 3.0

        def sensor_toml(self):
            lines = super().sensor_toml().replace("diameter_mm = 3.0", f"diameter_mm = {diameter_mm}")
            return "\n".join(line for line in lines.splitlines() if not line.startswith("rings"))

    dome = Pins(width=640, height=480, focal_px=380.0, bead_bgr=(235, 240, 240), skin_bgr=(110, 105, 115))
    dataset = read_dataset(dome.write(tmp_path / "pins", presses=presses))
    calibration = calibrate(dataset, dome=load_dome_model())
    assert np.bincount(calibration.ring_of()).tolist() == shell_sizes(rings)
    assert calibration.appearance.bright
    drawn_px = dome.project(dome.beads_mm())
    nearest = np.linalg.norm(calibration.reference().position_px[:, None] - drawn_px[None], axis=2).min(
        axis=1
    )
    assert nearest.max() < 0.15
    true = [press.position_mm for press in dataset.split("test")]
    assert apart_mm(true, positions(calibration, dataset, "test", Method.CORRECTED)).max() < 1.0
    assert apart_mm(true, positions(calibration, dataset, "test", Method.PAPER)).mean() < 6


def test_two_blobs_refined_onto_one_bead_make_one_bead(drawn_dome, tmp_path, monkeypatch):
    """They made a spacing of 0 and an IndexError."""
    dataset = without_rings(read_dataset(drawn_dome.write(tmp_path / "d")))
    found = registration.beads_without_layout

    def twice(*arguments):
        blobs, *rest = found(*arguments)
        again = Blobs(
            np.concatenate([blobs.position_px, blobs.position_px[:5] + 1.0]),
            np.concatenate([blobs.strength, blobs.strength[:5]]),
        )
        return again, *rest

    monkeypatch.setattr(registration, "beads_without_layout", twice)
    calibration = calibrate(dataset)
    assert len(calibration.beads) == 85
    assert calibration.reference().neighbourhood.spacing_px.min() > 5
