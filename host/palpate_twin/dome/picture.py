"""Draw a press: the meridian section through the contact, and the bead sphere as the camera sees it."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from palpate_host.common.figure_file import save_figure
from palpate_twin.dome import field_grid
from palpate_twin.dome.mesh import DomeMesh
from palpate_twin.dome.press import PressedDome
from palpate_twin.dome.sampling import Sampler


def draw_press(mesh: DomeMesh, pressed: PressedDome, path: Path) -> None:
    """Write a picture. The path's suffix selects the format."""
    with mpl.rc_context({"font.size": 9}):
        figure = Figure(figsize=(11, 5), layout="constrained")
        section, beads = figure.subplots(1, 2)
        _section(section, mesh, pressed)
        _beads(beads, mesh, pressed)
        meridional_mm, azimuthal_mm = pressed.shear_mm
        figure.suptitle(
            f"{pressed.probe.label}, contact angle {90 - np.degrees(pressed.theta_rad):.0f} deg, depth "
            f"{pressed.depth_mm:g} mm, slide {meridional_mm:g} and {azimuthal_mm:g} mm"
        )
        save_figure(figure, path)


def _section(axes: Axes, mesh: DomeMesh, pressed: PressedDome) -> None:
    """Draw lines through the wall in the plane y = 0, before (grey) and after the press."""
    theta = np.radians(np.linspace(-89.5, 89.5, 121))
    radii_mm = mesh.outer_radius_mm - mesh.wall_mm * np.linspace(0.002, 0.998, 5)
    circle = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=1)
    points = (radii_mm[:, None, None] * circle).reshape(-1, 3)
    moved = points + Sampler(mesh, points)(pressed.displacement_mm)
    for before, after in zip(points.reshape(5, -1, 3), moved.reshape(5, -1, 3), strict=True):
        axes.plot(before[:, 0], before[:, 2], color="0.8", linewidth=0.8)
        axes.plot(after[:, 0], after[:, 2], color="tab:blue", linewidth=1.0)
    centre, force = pressed.pressure_centre_mm, pressed.force_per_mu_mm2
    size = np.linalg.norm(force) or 1.0
    start = centre - 12 * force / size
    axes.annotate(
        "", (centre[0], centre[2]), (start[0], start[2]), arrowprops={"arrowstyle": "->", "color": "tab:red"}
    )
    axes.text(start[0], start[2], f"{size:.1f} mm² · µ", color="tab:red")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", title="section y = 0", aspect="equal")


def _beads(axes: Axes, mesh: DomeMesh, pressed: PressedDome) -> None:
    """Draw the displacement on the bead sphere: magnitude in colour, components x and y as arrows."""
    points = field_grid.BEAD_RADIUS_MM * field_grid.ring_directions()
    moved = Sampler(mesh, points)(pressed.displacement_mm)
    drawn = axes.scatter(points[:, 0], points[:, 1], c=np.linalg.norm(moved, axis=1), s=12, cmap="viridis")
    axes.quiver(
        points[:, 0], points[:, 1], moved[:, 0], moved[:, 1], angles="xy", scale_units="xy", scale=0.5
    )
    axes.figure.colorbar(drawn, ax=axes, label="displacement (mm)")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", title="bead sphere, arrows twice as long", aspect="equal")
