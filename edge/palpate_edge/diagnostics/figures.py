"""Pictures for people: beads found in one image, layout residuals of a calibration, markers followed."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Image
from palpate_edge.diagnostics.canvas import GREEN, RED, YELLOW, Panel, rainbow
from palpate_edge.diagnostics.video_tracking import Followed
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.geometry.marker_layout import learn_layout
from palpate_edge.geometry.sensor import View, bead_layout_mm

SHEET_WIDTH = 1280  # of a single picture, pixels
RESIDUAL_SCALE = 20


def draw_beads(image: Image, position_px: Array, diameter_px: float) -> Image:
    """The image, twice as large, with a numbered circle about each bead."""
    panel = Panel(image, 2.0)
    for number, place in enumerate(position_px):
        panel.circle(place, diameter_px / 2, GREEN)
        panel.text(place, str(number), YELLOW)
    return panel.canvas


def draw_followed(followed: Followed) -> Image:
    """Draw the track of each marker: the way forth as a line, a circle where it began (red if it did not
    return or is probably no marker), its number and the share of frames in which it was found."""
    panel = Panel(followed.first, SHEET_WIDTH / followed.first.shape[1], dim=0.75)
    found = followed.forth_found.mean(axis=0)
    home = followed.home & ~followed.doubtful
    for number, start in enumerate(followed.start_px):
        panel.lines(followed.forth_px[:, number], rainbow(number * 0.382 % 1.0))
        panel.circle(start, 3.0, GREEN if home[number] else RED, 2)
        panel.text(start + np.array([4.0, -1.0]), f"{number} {100 * found[number]:.0f}%", YELLOW, 0.45)
    return panel.titled(
        f"{len(followed.lost)} frames, {len(home)} markers: {int(home.sum())} came back, "
        f"{int(followed.swapped.sum())} swapped",
        f"markers lost a frame {followed.lost.mean():.2f} (most {followed.lost.max()}); both ways agree in "
        f"{100 * followed.agreement:.2f} % of places; lines: way forth, %: frames in which it was found",
    )


def draw_residuals(image: Image, calibration: Calibration) -> Image:
    """A reference frame with, for each bead, an arrow from where the fitted layout has it to where it was
    found, `RESIDUAL_SCALE` times as long."""
    panel = Panel(image, SHEET_WIDTH / image.shape[1], dim=0.75)
    found_px = calibration.reference().position_px
    fitted_px = View(calibration.sensor.camera, calibration.pose).project(_fitted_layout_mm(calibration))
    off_px = found_px - fitted_px
    for number, (fitted, off) in enumerate(zip(fitted_px, off_px, strict=True)):
        panel.circle(fitted, 1.5, GREEN, -1)
        panel.arrow(fitted, fitted + RESIDUAL_SCALE * off, RED)
        panel.text(fitted + np.array([3.0, -3.0]), str(number), YELLOW)
    size_px = np.linalg.norm(off_px, axis=1)
    pose = calibration.pose
    offset = ", ".join(f"{value:+.2f}" for value in pose.offset_mm)
    turn = ", ".join(f"{value:+.2f}" for value in np.degrees(pose.rotation_rad))
    return panel.titled(
        f"{len(size_px)} beads: residual {calibration.residual_px:.2f} px rms, {size_px.max():.2f} px at "
        f"most (arrows x {RESIDUAL_SCALE})",
        f"camera off by {offset} mm, turned by {turn} deg, focal length x {pose.focal_scale:.4f}; "
        f"contact above {calibration.contact_threshold_px:.3f} px",
    )


def _fitted_layout_mm(calibration: Calibration) -> Array:
    """Return each bead's place by sensor.toml's layout or the learned rings, (n, 3) in F."""
    sensor = calibration.sensor
    if sensor.markers.rings:
        return bead_layout_mm(sensor.markers)[0]
    found_px = calibration.reference().position_px
    layout = learn_layout(sensor.camera, sensor.markers.radius_mm, found_px)
    position_mm = np.empty_like(layout.position_mm)
    position_mm[layout.order] = layout.position_mm
    return position_mm
