"""Every step from one frame to its contact, by the paper's method and by the corrected one, to look at."""

from __future__ import annotations

from dataclasses import dataclass

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import DatasetError
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.displacement_field import CanonicalField, DisplacementReader
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.estimation.paper_method import RawContact, corrected_theta, raw_contact
from palpate_edge.estimation.skin_motion import SkinMotion
from palpate_edge.estimation.virtual_points import VirtualPointMesh, VirtualPoints
from palpate_edge.geometry.sensor import View
from palpate_edge.vision.beads import Beads
from palpate_edge.vision.tracker import Tracker


@dataclass(frozen=True, slots=True)
class Steps:
    """One frame's way through both methods; `corrected` is None when the calibration holds no model."""

    image: Image
    calibration: Calibration
    beads: Beads
    motion_px: float
    mesh: VirtualPointMesh
    points: VirtualPoints
    change: Array
    raw: RawContact
    theta_rad: float
    field: CanonicalField
    paper: Contact
    corrected: Contact | None

    @property
    def view(self) -> View:
        return View(self.calibration.sensor.camera, self.calibration.pose)


def take_steps(image: Image, calibration: Calibration, name: str) -> Steps:
    """Every step of both methods on one image. Raises DatasetError when it shows none of the beads."""
    frame, reference = Frame(image, 0, 0, name), calibration.reference()
    paper = Estimator(calibration, Method.PAPER).estimate(frame)
    corrected = Estimator(calibration, Method.CORRECTED).estimate(frame) if calibration.model else None
    if not paper.beads_found:
        raise DatasetError(f"{name}: {paper.reason}: give a frame of the sensor that was calibrated")
    view, radius_mm = View(calibration.sensor.camera, calibration.pose), calibration.sensor.markers.radius_mm
    beads = Tracker(reference).follow_image(image, calibration.appearance)
    mesh = VirtualPointMesh(reference.position_px, calibration.ring_of())
    points = mesh.points(beads.position_px, beads.found)
    raw = raw_contact(mesh, points, view, radius_mm)
    return Steps(
        image=image,
        calibration=calibration,
        beads=beads,
        motion_px=SkinMotion(reference).measure(beads).size_px,
        mesh=mesh,
        points=points,
        change=mesh.area_change(points),
        raw=raw,
        theta_rad=corrected_theta(calibration.paper, raw.theta_rad),
        field=DisplacementReader(
            reference.position_px, view, radius_mm, calibration.noise_px, calibration.typical_fields
        ).read(beads),
        paper=paper,
        corrected=corrected,
    )


def contact_text(contact: Contact) -> str:
    """Return position and normal force of a contact in one line."""
    if not contact.valid:
        return f"rejected: {contact.reason}"
    if contact.position_mm is None:
        return "nothing touches"
    x, y, z = contact.position_mm
    force = (
        "force unknown" if contact.normal_force_N is None else f"normal force {contact.normal_force_N:.2f} N"
    )
    return f"contact at {x:+.2f}, {y:+.2f}, {z:+.2f} mm in F; {force}"
