"""Drawing of a sensor for its construction: section of the dome, bead layout, table of rings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Wedge

from palpate_edge.geometry.sensor import Camera, Sensor, bead_layout_mm
from palpate_host.common.figure_file import save_figure

SILICONE, BEAD, SIGHT = "#cfd8dc", "#bf360c", "#f9a825"


@dataclass(frozen=True)
class RingPlan:
    """Dimensions of a ring of beads. spacing_mm: between neighbours on the ring, 0 for a single bead."""

    theta_deg: float
    count: int
    phi0_deg: float
    circle_radius_mm: float
    height_mm: float  # above the base plane
    spacing_mm: float


def ring_plans(sensor: Sensor) -> list[RingPlan]:
    """Return the rings from the apex to the base, on the sphere of the bead centres."""
    plans = []
    for ring in sensor.markers.rings:
        theta = math.radians(ring.theta_deg)
        circle_mm = sensor.markers.radius_mm * math.sin(theta)
        spacing_mm = 2 * circle_mm * math.sin(math.pi / ring.count) if ring.count > 1 else 0.0
        height_mm = sensor.markers.radius_mm * math.cos(theta)
        plans.append(RingPlan(ring.theta_deg, ring.count, ring.phi0_deg, circle_mm, height_mm, spacing_mm))
    return plans


def closest_beads_mm(sensor: Sensor) -> float:
    """Return the smallest distance between two bead centres; infinite with fewer than two."""
    points, _ = bead_layout_mm(sensor.markers)
    apart = np.linalg.norm(points[:, None] - points[None, :], axis=2)
    return float(apart[~np.eye(len(points), dtype=bool)].min(initial=math.inf))


def plan_text(sensor: Sensor) -> str:
    """Return the dimensions and a line for each ring as text."""
    dome, markers = sensor.dome, sensor.markers
    inner_mm = dome.outer_radius_mm - dome.wall_mm
    cover_mm = dome.outer_radius_mm - markers.radius_mm - markers.diameter_mm / 2
    behind_mm = markers.radius_mm - markers.diameter_mm / 2 - inner_mm
    lines = [
        f"dome: outer radius {dome.outer_radius_mm:g} mm, inner {inner_mm:g} mm, wall {dome.wall_mm:g} mm",
        f"beads: {sum(ring.count for ring in markers.rings)} of {markers.diameter_mm:g} mm, centres on"
        f" {markers.radius_mm:g} mm: {cover_mm:g} mm of silicone over them, {behind_mm:g} mm behind",
    ]
    if not markers.rings:
        return "\n".join([*lines, "no rings: the layout is learned from the first frame"])
    lines += [f"closest bead centres: {closest_beads_mm(sensor):.2f} mm", ""]
    lines += ["theta deg  beads  first at deg  circle radius mm  height mm  spacing mm"]
    lines += [
        f"{plan.theta_deg:9g}  {plan.count:5}  {plan.phi0_deg:12g}  {plan.circle_radius_mm:16.2f}"
        f"  {plan.height_mm:9.2f}  {plan.spacing_mm:10.2f}"
        for plan in ring_plans(sensor)
    ]
    return "\n".join(lines)


def draw_sensor(sensor: Sensor, path: Path) -> None:
    """Write the drawing. The path's suffix selects the format."""
    with mpl.rc_context({"font.size": 9, "svg.hashsalt": "palpate", "svg.fonttype": "none"}):
        figure = Figure(figsize=(11, 6), layout="constrained")
        section, layout = figure.subplots(1, 2)
        _draw_section(section, sensor)
        _draw_layout(layout, sensor)
        save_figure(figure, path)


def _draw_section(axes: Axes, sensor: Sensor) -> None:
    """Draw the section through the apex: wall, beads of each ring, camera and field of view."""
    dome, markers, camera = sensor.dome, sensor.markers, sensor.camera
    axes.add_patch(
        Wedge((0, 0), dome.outer_radius_mm, 0, 180, width=dome.wall_mm, facecolor=SILICONE, edgecolor="0.3")
    )
    for plan in ring_plans(sensor):
        for side in (-1, 1):
            centre = side * plan.circle_radius_mm, plan.height_mm
            axes.add_patch(Circle(centre, markers.diameter_mm / 2, facecolor=BEAD, edgecolor="none"))
        reach = dome.outer_radius_mm + 2
        theta = math.radians(plan.theta_deg)
        where = reach * math.sin(theta), reach * math.cos(theta)
        axes.text(*where, f"{plan.theta_deg:g}°", ha="left", va="center")
    x_mm, _, z_mm = camera.position_mm
    half = math.radians(half_view_deg(camera))
    far = dome.outer_radius_mm - z_mm
    for side in (-1, 1):
        far_mm = min(far * math.tan(half), dome.outer_radius_mm)
        axes.plot([x_mm, x_mm + side * far_mm], [z_mm, z_mm + far_mm / math.tan(half)], color=SIGHT, lw=1)
    axes.plot(x_mm, z_mm, marker="s", color="0.2", markersize=9)
    axes.annotate(f"camera, z = {z_mm:g} mm", (x_mm, z_mm), (8, 0), textcoords="offset points", va="center")
    inner_mm = dome.outer_radius_mm - dome.wall_mm
    axes.text(-inner_mm, -4, f"inner radius {inner_mm:g} mm")
    axes.text(-inner_mm, -8, f"outer radius {dome.outer_radius_mm:g} mm")
    axes.axhline(0, color="0.6", lw=0.6)
    edge = dome.outer_radius_mm + 6
    axes.set(xlim=(-edge, edge), ylim=(min(z_mm, 0) - 6, edge), aspect="equal")
    axes.set(xlabel="x (mm)", ylabel="z (mm)", title="section, base plane at z = 0")


def half_view_deg(camera: Camera) -> float:
    """Return half of the camera's horizontal angle of view, without distortion; at most 80 deg."""
    fx, _, cx, _ = camera.matrix
    if camera.model == "fisheye":
        return min(math.degrees(cx / fx), 80.0)
    return min(math.degrees(math.atan(cx / fx)), 80.0)


def _draw_layout(axes: Axes, sensor: Sensor) -> None:
    """Draw the layout as the camera sees it: x to the right, y down, a circle per ring."""
    dome, markers = sensor.dome, sensor.markers
    for radius_mm in (dome.outer_radius_mm, dome.outer_radius_mm - dome.wall_mm):
        axes.add_patch(Circle((0, 0), radius_mm, fill=False, edgecolor="0.6"))
    points, _ = bead_layout_mm(markers)
    for x_mm, y_mm, _ in points:
        axes.add_patch(Circle((x_mm, y_mm), markers.diameter_mm / 2, facecolor=BEAD, edgecolor="none"))
    for plan in ring_plans(sensor):
        axes.add_patch(Circle((0, 0), plan.circle_radius_mm, fill=False, edgecolor="0.85", lw=0.6))
        between = math.radians(plan.phi0_deg + 180 / plan.count)
        if plan.count > 1:
            where = plan.circle_radius_mm * math.cos(between), plan.circle_radius_mm * math.sin(between)
            axes.text(*where, f"{plan.count}", ha="center", va="center")
    edge = dome.outer_radius_mm + 2
    title = f"{len(points)} beads from the camera"
    axes.set(xlim=(-edge, edge), ylim=(edge, -edge), aspect="equal")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", title=title)
