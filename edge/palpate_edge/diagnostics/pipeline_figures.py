"""The pictures of :mod:`palpate_edge.diagnostics.pipeline_steps`, one a step, on one sheet.

Numbers in the titles are the paper's equations and figures; lengths are in px in the image, in mm in frame F.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.common.contact import Contact
from palpate_edge.diagnostics.canvas import CYAN, GREEN, GREY, RED, WHITE, YELLOW, Panel, diverging, sheet
from palpate_edge.diagnostics.pipeline_steps import Steps, contact_text
from palpate_edge.estimation.displacement_field import canonical_directions
from palpate_edge.estimation.paper_method import on_dome
from palpate_edge.estimation.virtual_points import ellipse_points
from palpate_edge.geometry.angles import azimuth, polar_angle, rotation_about_z

PANEL_WIDTH = 800
COLUMNS = 3
ZOOM = 2.5  # of close-ups
DIM = 0.7  # of the image behind drawings
MOTION_SCALE = 8  # of the virtual points' motion
FIELD_EDGE_RAD = np.radians(80.0)  # polar angle at the edge of the field's picture
LONGEST_ARROW_RAD = np.radians(14.0)


def draw_steps(steps: Steps) -> Image:
    """All steps on one sheet."""
    pictures = (
        _beads,
        _ellipses,
        _virtual_points,
        _triangles,
        _area_change,
        _weights,
        _position_correction,
        _canonical_field,
        _contacts,
    )
    return sheet([picture(steps) for picture in pictures], COLUMNS)


def _whole(steps: Steps) -> Panel:
    """The image to draw on."""
    return Panel(steps.image, PANEL_WIDTH / steps.image.shape[1], DIM)


def _close_up(steps: Steps) -> Panel:
    """The image about the contact, or all of it where there is none."""
    if not steps.paper.in_contact:
        return _whole(steps)
    return Panel(steps.image, PANEL_WIDTH / steps.image.shape[1], DIM, steps.raw.point_px, ZOOM)


def _beads(steps: Steps) -> Image:
    panel, found = _whole(steps), steps.beads.found
    sizes_px = steps.calibration.reference().diameter_px
    for number, (place, size) in enumerate(zip(steps.beads.position_px, sizes_px, strict=True)):
        if found[number]:
            panel.circle(place, size / 2, GREEN)
            panel.text(place, str(number), YELLOW)
        else:
            panel.cross(place, RED)
            panel.text(place, str(number), RED)
    threshold_px = steps.calibration.contact_threshold_px
    return panel.titled(
        f"1  Beads: {found.sum()} of {len(found)} found",
        f"red: lost, placed by their neighbours. Skin motion {steps.motion_px:.3f} px rms, contact above "
        f"{threshold_px:.3f} px",
    )


def _ellipses(steps: Steps) -> Image:
    panel = _whole(steps)
    for place in steps.beads.position_px[steps.beads.found]:
        panel.circle(place, 2.0, YELLOW, -1)
    for ellipse in steps.points.ellipses:
        panel.lines(ellipse_points(ellipse, 0.0, 90), CYAN, closed=True)
        panel.cross(np.array(ellipse[:2]), CYAN, 2.0, 1)
    rings = len(np.unique(steps.mesh.ring_of))
    return panel.titled(
        f"2  Rings and fitted ellipses: {len(steps.points.ellipses)} of {rings} rings (Fig. 5)",
        "yellow: beads; least squares over the beads of each ring; a ring of fewer than 6 has none",
    )


def _virtual_points(steps: Steps) -> Image:
    panel = _whole(steps)
    for rest, now in zip(steps.mesh.reference_px, steps.points.position_px, strict=True):
        panel.lines(np.array([rest, rest + MOTION_SCALE * (now - rest)]), YELLOW)
    for place, trusted in zip(steps.points.position_px, steps.points.trusted, strict=True):
        panel.circle(place, 2.5, GREEN if trusted else RED, -1)
    moved_px = np.linalg.norm(steps.points.position_px - steps.mesh.reference_px, axis=1)
    return panel.titled(
        f"3  Virtual points, Eq. (1): {int(steps.points.trusted.sum())} of {len(moved_px)}",
        f"yellow: motion x {MOTION_SCALE}, largest {moved_px.max():.1f} px; red: ring with too few beads",
    )


def _triangles(steps: Steps) -> Image:
    panel = _whole(steps)
    for triangle in steps.mesh.triangles:
        panel.lines(steps.points.position_px[triangle], GREEN, closed=True)
    return panel.titled(
        f"4  Delaunay triangles of the virtual points: {len(steps.mesh.triangles)} (Fig. 4)",
        "triangulated once on the untouched sensor, so that each is compared with itself",
    )


def _area_change(steps: Steps) -> Image:
    panel, change = _whole(steps), steps.change
    largest = max(float(np.abs(change).max()), 1e-9)
    for triangle in steps.mesh.triangles:
        panel.fill(steps.points.position_px[triangle], diverging(float(change[triangle].mean()) / largest))
    for place, value in zip(steps.points.position_px, change, strict=True):
        panel.circle(place, 4.0, diverging(float(value) / largest), -1)
        panel.circle(place, 4.0, WHITE)
    return panel.titled(
        "5  Change of the mean triangle area about each point (Fig. 7b)",
        f"red: grown, up to {100 * change.max():+.1f} %; blue: shrunk, down to {100 * change.min():+.1f} %",
    )


def _weights(steps: Steps) -> Image:
    panel, raw, places = _close_up(steps), steps.raw, steps.mesh.reference_px
    panel.circle(places[raw.centre], 4.0, RED, 2)
    panel.text(places[raw.centre] + (5.0, 9.0), f"vp1 {100 * steps.change[raw.centre]:+.1f}%", RED, 0.45)
    for point, weight in zip(raw.around, raw.weight, strict=True):
        panel.lines(np.array([places[point], raw.point_px]), CYAN)
        panel.circle(places[point], 2.0 + 12 * float(weight), CYAN, 2)
        panel.text(places[point] + (3.0, -6.0), f"{weight:.2f}", CYAN, 0.45)
    panel.cross(raw.point_px, YELLOW, 3.0)
    return panel.titled(
        "6  Contact by Eq. (2): mean of the neighbours, weight 1 / (vp1a - vpka)",
        f"red: largest area change; blue: neighbours with weights; yellow: P_c at {raw.point_px[0]:.1f}, "
        f"{raw.point_px[1]:.1f} px",
    )


def _position_correction(steps: Steps) -> Image:
    panel, raw, paper = _close_up(steps), steps.raw, steps.paper
    now_px = steps.view.project(
        on_dome(steps.theta_rad, raw.phi_rad, steps.calibration.sensor.markers.radius_mm)[None]
    )[0]
    panel.cross(raw.point_px, YELLOW, 3.0)
    if paper.in_contact:
        panel.arrow(raw.point_px, now_px, GREEN)
        panel.circle(now_px, 3.0, GREEN, 2)
    turned = f"theta {np.degrees(raw.theta_rad):.1f} -> {np.degrees(steps.theta_rad):.1f} deg"
    return panel.titled(
        f"7  Position correction function: {turned}; force by Eq. (3)",
        f"{contact_text(paper)}; P_dist {raw.spread_px:+.2f} px",
    )


def _canonical_field(steps: Steps) -> Image:
    """Polar angle outwards, the canonical frame's x axis to the right."""
    height, width = steps.image.shape[:2]
    panel = Panel(np.full((height, width, 3), 34, dtype=np.uint8), PANEL_WIDTH / width)
    middle, reach = np.array([width / 2, height / 2]), 0.48 * height / FIELD_EDGE_RAD
    for theta_deg in (15, 30, 45, 60, 75):
        panel.circle(middle, reach * np.radians(theta_deg), (70, 66, 62))
        panel.text(middle + np.array([2.0, reach * np.radians(theta_deg) - 2]), f"{theta_deg}", GREY)
    flat = _flat(canonical_directions())
    outwards = flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    outwards[np.linalg.norm(flat, axis=1) < 1e-9] = (1.0, 0.0)
    sideways = np.stack([-outwards[:, 1], outwards[:, 0]], axis=1)
    meridional, azimuthal = np.split(steps.field.values, 2)
    motion_mm = meridional[:, None] * outwards + azimuthal[:, None] * sideways
    largest_mm = float(np.linalg.norm(motion_mm, axis=1).max())
    for place, motion in zip(flat, motion_mm * LONGEST_ARROW_RAD / max(largest_mm, 1e-9), strict=True):
        panel.arrow(middle + reach * place, middle + reach * (place + motion), CYAN)
    if steps.corrected is not None and steps.corrected.position_mm is not None:
        turn = rotation_about_z(steps.field.azimuth_rad)
        around = _circle_mm(steps.corrected, steps.calibration.sensor.dome.outer_radius_mm) @ turn
        contact = np.array([steps.corrected.position_mm]) @ turn
        panel.lines(middle + reach * _flat(around), GREEN, 2, closed=True)
        panel.cross(middle + reach * _flat(contact)[0], GREEN)
    return panel.titled(
        "8  Displacement field in the canonical frame (corrected method)",
        f"longest arrow {largest_mm:.3f} mm; frame turned by {np.degrees(steps.field.azimuth_rad):+.1f} deg "
        "about z; circles: polar angle, deg",
    )


def _contacts(steps: Steps) -> Image:
    panel, radius_mm = _close_up(steps), steps.calibration.sensor.dome.outer_radius_mm
    if steps.paper.position_mm is not None:
        panel.cross(steps.view.project(np.array([steps.paper.position_mm]))[0], YELLOW, 3.0)
    corrected = steps.corrected
    if corrected is None:
        return panel.titled("9  Corrected contact: the calibration holds no model", "yellow: paper's method")
    if corrected.position_mm is not None:
        panel.lines(steps.view.project(_circle_mm(corrected, radius_mm)), GREEN, 2, closed=True)
        panel.cross(steps.view.project(np.array([corrected.position_mm]))[0], GREEN, 1.5, 1)
    if corrected.radius95_mm is None:
        return panel.titled("9  Corrected contact", contact_text(corrected))
    return panel.titled(
        f"9  Corrected contact, 95 % within {corrected.radius95_mm:.2f} mm (green); paper's (yellow)",
        contact_text(corrected),
    )


def _circle_mm(contact: Contact, radius_mm: float) -> Array:
    """The contact's 95 % circle (60, 3) on the outer sphere."""
    assert contact.position_mm is not None
    normal = np.array(contact.position_mm) / radius_mm
    one = np.cross(normal, (1.0, 0.0, 0.0) if abs(normal[0]) < 0.9 else (0.0, 1.0, 0.0))
    one /= np.linalg.norm(one)
    other = np.cross(normal, one)
    turn = np.linspace(0, 2 * np.pi, 60, endpoint=False)[:, None]
    angle = (contact.radius95_mm or 0.0) / radius_mm
    return np.asarray(
        radius_mm * (np.cos(angle) * normal + np.sin(angle) * (np.cos(turn) * one + np.sin(turn) * other))
    )


def _flat(points: Array) -> Array:
    """(n, 3) of F or of the canonical frame -> (n, 2): polar angle in rad along the azimuth."""
    theta, phi = polar_angle(points), azimuth(points)
    return np.stack([theta * np.cos(phi), theta * np.sin(phi)], axis=1)
