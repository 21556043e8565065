"""Pictures of one fingertip for people: the camera's image with its beads, and the dome with the contact."""

from __future__ import annotations

import cv2
import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.diagnostics.canvas import GREEN, RED, YELLOW, Panel
from palpate_edge.vision.beads import Beads, Reference
from palpate_host.common.tip_contact import TipContact

MOTION_SCALE = 6
"""Length of a bead's arrow over its displacement."""
ELEVATION_RAD = np.radians(35.0)  # of the view of the dome
DOME_SHARE = 0.4  # of the panel's side: the dome's radius
FORCE_MM_N = 8.0  # length of the force arrow, mm on the dome for 1 N
INK, LINE, PALE, CONTACT = (70, 70, 70), (190, 180, 170), (250, 246, 242), (50, 50, 220)
FONT, SHIFT = cv2.FONT_HERSHEY_SIMPLEX, 4


def bead_panel(image: Image, reference: Reference, beads: Beads, height: int) -> Image:
    """Return the image, `height` pixels high: found beads in green with arrows of their displacement, lost
    beads as red crosses."""
    panel = Panel(image, height / image.shape[0])
    for place, rest, size, is_found in zip(
        beads.position_px, reference.position_px, reference.diameter_px, beads.found, strict=True
    ):
        if is_found:
            panel.circle(place, size / 2, GREEN)
            panel.arrow(rest, rest + MOTION_SCALE * (place - rest), YELLOW)
        else:
            panel.cross(place, RED)
    return _captioned(
        panel.canvas,
        f"camera: {int(beads.found.sum())} of {len(beads.found)} beads, arrows x {MOTION_SCALE}",
        (255, 255, 255),
    )


def dome_panel(contact: TipContact, radius_mm: float, height: int) -> Image:
    """Return a square view of the dome from obliquely above, with contact, force and 95 % radius."""
    canvas = np.full((height, height, 3), PALE, dtype=np.uint8)
    scale = DOME_SHARE * height / radius_mm

    def draw(points_mm: Array, colour: tuple[int, int, int], thickness: int = 1) -> None:
        cv2.polylines(
            canvas, [_on_panel(points_mm, scale, height)], False, colour, thickness, cv2.LINE_AA, SHIFT
        )

    turn = np.linspace(0.0, 2 * np.pi, 73)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for angle_rad in np.radians([90.0, 60.0, 30.0]):
        ring = np.column_stack([np.sin(angle_rad) * circle, np.full(len(turn), np.cos(angle_rad))])
        draw(radius_mm * ring, LINE)
    arc = np.linspace(-np.pi / 2, np.pi / 2, 37)
    for azimuth_rad in np.radians([0.0, 45.0, 90.0, 135.0]):
        flat = np.array([np.cos(azimuth_rad), np.sin(azimuth_rad)])
        draw(radius_mm * np.column_stack([np.sin(arc)[:, None] * flat, np.cos(arc)]), LINE)
    if not (contact.valid and contact.in_contact):
        return _captioned(canvas, "no contact" if contact.valid else "no valid contact", INK)
    if contact.position_mm is None or contact.normal_force_N is None:
        return _captioned(canvas, "contact, place or force unknown", INK)
    place = np.array(contact.position_mm)
    outward = place / np.linalg.norm(place)
    side = np.cross(outward, [0.0, 1.0, 0.0] if abs(outward[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    if contact.radius95_mm is not None:
        ring = circle @ np.stack([side, np.cross(outward, side)])
        draw(place + contact.radius95_mm * ring, CONTACT)
    start, end = _on_panel(
        np.stack([place + FORCE_MM_N * contact.normal_force_N * outward, place]), scale, height
    ).tolist()
    cv2.arrowedLine(canvas, start, end, CONTACT, 2, cv2.LINE_AA, SHIFT, 0.2)
    cv2.circle(canvas, end, 4 << SHIFT, CONTACT, -1, cv2.LINE_AA, SHIFT)
    x, y, z = contact.position_mm
    about = "" if contact.radius95_mm is None else f" +-{contact.radius95_mm:.1f}"
    return _captioned(canvas, f"{x:.1f} {y:.1f} {z:.1f}{about} mm, {contact.normal_force_N:.2f} N", INK)


def _on_panel(points_mm: Array, scale: float, side: int) -> Array:
    """Return places (n, 2) on the panel, in 16ths of a pixel, of points (n, 3) in F: parallel projection."""
    up = points_mm[:, 2] * np.cos(ELEVATION_RAD) + points_mm[:, 1] * np.sin(ELEVATION_RAD)
    across = np.column_stack([points_mm[:, 0], -up]) * scale + [side / 2, 0.66 * side]
    return np.rint(across * (1 << SHIFT)).astype(np.int32)


def _captioned(canvas: Image, text: str, colour: tuple[int, int, int]) -> Image:
    """Return the picture with a line of text at its upper edge."""
    cv2.putText(canvas, text, (10, 22), FONT, 0.5, colour, 1, cv2.LINE_AA)
    return canvas
