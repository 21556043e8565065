"""Draw docs/jig.svg, a jig from above and in section: ``python -m bench.jig_picture``."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from palpate_edge.jig.jig_plan import Hole, JigSize, plan_holes

RADIUS_MM = 30.0
SIZE = JigSize(2 * RADIUS_MM)
PRINT, DOME, ROD = "#cbd5e1", "#e9a23b", "#64748b"


def main() -> None:
    """Draw the jig of a dome of 30 mm."""
    mpl.rcParams["svg.hashsalt"] = "palpate"
    mpl.rcParams["svg.fonttype"] = "none"
    figure = Figure(figsize=(8, 3.6), layout="constrained")
    above, section = figure.subplots(1, 2)
    holes = plan_holes(RADIUS_MM, SIZE)
    _draw_above(above, holes)
    _draw_section(section, holes)
    for axes in (above, section):
        axes.set_aspect("equal")
        axes.autoscale_view()
        axes.axis("off")
    figure.savefig(Path("docs/jig.svg"), format="svg", metadata={"Date": None})


def _draw_above(axes: Axes, holes: tuple[Hole, ...]) -> None:
    """Draw the guides with their numbers as the camera's picture has them: x to the right, y down."""
    outer_mm = RADIUS_MM + SIZE.gap_mm + SIZE.wall_mm
    axes.add_patch(Circle((0, 0), outer_mm, facecolor="white", edgecolor=ROD))
    for hole in holes:
        x, y, _ = outer_mm * np.array(hole.outward)
        axes.add_patch(Circle((x, -y), SIZE.hole_mm / 2, facecolor=PRINT, edgecolor=ROD))
        axes.text(x, -y, str(hole.number), ha="center", va="center")
    axes.annotate("arrow: right side\nof the picture", (outer_mm, 0), (outer_mm + 6, 0), va="center")


def _draw_section(axes: Axes, holes: tuple[Hole, ...]) -> None:
    """Draw cap, guides and skirt through azimuths 0 and 180, with dome and a rod."""
    inner_mm, housing_mm = RADIUS_MM + SIZE.gap_mm, (SIZE.housing_mm + SIZE.fit_mm) / 2
    cap_mm, skirt_mm = inner_mm + SIZE.wall_mm, max(inner_mm, housing_mm) + SIZE.wall_mm
    half = np.linspace(0, np.pi, 60)
    arc = np.stack([np.cos(half), np.sin(half)], axis=1)
    for side in (1, -1):
        x, low = np.array([housing_mm, skirt_mm]) * side, -SIZE.skirt_mm
        corners = [(x[0], low), (x[1], low), (x[1], SIZE.wall_mm), (x[0], SIZE.wall_mm)]
        axes.add_patch(Polygon(corners, facecolor=PRINT, edgecolor="none"))
    axes.add_patch(Polygon([*(cap_mm * arc), *(inner_mm * arc[::-1])], facecolor=PRINT, edgecolor="none"))
    shown = [hole for hole in holes if hole.phi_deg in (0.0, 180.0)]
    for hole in shown:
        _strip(axes, hole, (inner_mm, cap_mm + SIZE.guide_mm), SIZE.guide_diameter_mm, PRINT)
        _strip(axes, hole, (inner_mm - 0.5, cap_mm + SIZE.guide_mm + 0.5), SIZE.hole_mm, "white")
    _strip(axes, holes[0], (RADIUS_MM + SIZE.rod_mm / 2, cap_mm + SIZE.guide_mm + 18), SIZE.rod_mm, ROD)
    axes.add_patch(Circle((0, RADIUS_MM + SIZE.rod_mm / 2), SIZE.rod_mm / 2, facecolor=ROD))
    axes.add_patch(Polygon(RADIUS_MM * arc, facecolor=DOME, edgecolor="none"))
    axes.text(0, RADIUS_MM / 2, "dome", ha="center")
    axes.text(SIZE.rod_mm, cap_mm + SIZE.guide_mm + 10, "rod, with a weight")


def _strip(axes: Axes, hole: Hole, along_mm: tuple[float, float], width_mm: float, colour: str) -> None:
    """Draw a rectangle along the hole's axis."""
    x, _, z = hole.outward
    axis, aside = np.array([x, z]), np.array([z, -x]) * width_mm / 2
    low, high = (distance * axis for distance in along_mm)
    axes.add_patch(
        Polygon([low - aside, low + aside, high + aside, high - aside], facecolor=colour, edgecolor="none")
    )


if __name__ == "__main__":
    main()
