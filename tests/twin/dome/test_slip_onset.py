"""The slip flag compared with finite elements, where the sticking points of the surface are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from palpate_edge.calibration.training.dome_model import load_dome_model
from palpate_edge.calibration.training.kernel_ridge import fit
from palpate_edge.common.contact import Contact
from palpate_edge.estimation.displacement_field import DisplacementReader
from palpate_edge.estimation.slip import SlipDetector
from palpate_edge.geometry.angles import rotation_about_z
from palpate_edge.geometry.sensor import Markers, Ring, View, bead_layout_mm
from palpate_edge.vision.beads import Beads
from palpate_twin.dome.dome_samples import CAMERA, LAYOUTS
from palpate_twin.dome.equilibrium import ElasticDome
from palpate_twin.dome.mesh import Resolution, dome_mesh
from palpate_twin.dome.press import press_path
from palpate_twin.dome.probe import Probe
from palpate_twin.dome.sampling import Sampler

THETA_RAD = 0.3
DEPTH_MM, SLIDE_MM, STEPS = 1.5, 6.0, 20
SPEED_MM_S = 6.0
SHEAR_MODULUS = 0.1  # N/mm^2
NOISE_PX = 0.02


@dataclass(frozen=True)
class Step:
    """Position of the probe, share of touching points that slid in this step, and the estimated contact."""

    slide_mm: float
    slipping: float
    contact: Contact


def slide(probe, friction, slide_mm):
    """Press the dome, then slide the probe towards the base."""
    dome = ElasticDome(dome_mesh(resolution=Resolution(6, 4, 1), half=True), friction=friction)
    rings = tuple(Ring(theta, count) for theta, count in LAYOUTS[0])
    beads_mm = bead_layout_mm(Markers(26.5, 3.0, rings))[0]
    view = View(CAMERA)
    rest_px = view.project(beads_mm)
    reader = DisplacementReader(rest_px, view, 26.5)
    model = fit(None, load_dome_model(), 30.0)
    sample = Sampler(dome.mesh, beads_mm)
    random = np.random.default_rng(2)
    stops = [(DEPTH_MM * share, (0.0, 0.0)) for share in (0.25, 0.5, 0.75, 1.0)]
    stops += [(DEPTH_MM, (slide_mm * (n + 1) / STEPS, 0.0)) for n in range(STEPS)]
    last_anchor, steps = None, []
    for number, pressed in enumerate(press_path(dome, THETA_RAD, stops, probe)):
        anchor = pressed.state.anchor_mm
        slipping = 0.0
        if last_anchor is not None:
            both = np.isfinite(anchor[:, 0]) & np.isfinite(last_anchor[:, 0])
            slipping = float((np.linalg.norm(anchor - last_anchor, axis=1)[both] > 1e-6).mean())
        last_anchor = anchor
        place = view.project(beads_mm + sample(pressed.displacement_mm))
        place = place + NOISE_PX * random.standard_normal(place.shape)
        field = reader.read(Beads.from_positions(place, np.ones(len(place), dtype=np.bool_)))
        direction, force, radius_mm = model.predict(field.values[None], np.zeros(1))
        turn = rotation_about_z(field.azimuth_rad)
        position, force_N = 30 * turn @ direction[0], SHEAR_MODULUS * turn @ force[0]
        at_us = round(1e6 * number * SLIDE_MM / STEPS / SPEED_MM_S)
        contact = Contact(
            number, at_us, True, True, tuple(position), None, tuple(force_N), 1.0, "", 85, 85,
            radius95_mm=0.3 * float(radius_mm[0]),
        )  # fmt: skip
        steps.append(Step(pressed.shear_mm[0], slipping, contact))
    return steps


@pytest.mark.fem
@pytest.mark.slow
def test_a_sphere_that_slides_over_the_dome_slips():
    steps = slide(Probe.SPHERE10, 0.6, SLIDE_MM)
    detector = SlipDetector()
    flags = [detector.detect(step.contact) for step in steps]
    onset_mm = next(step.slide_mm for step in steps if step.slipping > 0.9)
    flagged_mm = next(step.slide_mm for step, slips in zip(steps, flags, strict=True) if slips)
    assert onset_mm <= flagged_mm <= onset_mm + 2.0
    assert np.mean(flags[10:]) > 0.9


@pytest.mark.fem
@pytest.mark.slow
def test_a_sphere_that_sticks_does_not():
    steps = slide(Probe.SPHERE10, 1.5, 1.0)
    assert max(step.slipping for step in steps[5:]) < 0.5
    detector = SlipDetector()
    assert not any(detector.detect(step.contact) for step in steps)


@pytest.mark.fem
@pytest.mark.slow
def test_a_sliding_flat_face_is_not_detected():
    """The beads do not move differently: docs/calibrating.md states this limit."""
    steps = slide(Probe.PLATE, 0.3, 0.8)
    detector = SlipDetector()
    assert not any(detector.detect(step.contact) for step in steps)
    assert steps[-5].slipping > 0.9
