"""The result of a calibration as an SVG picture: the dome's regions with their errors, verdict, figures."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from html import escape

from palpate_edge.daemon.check_rows import Verdict
from palpate_edge.estimation.calibration import Calibration, RegionErrors
from palpate_edge.guide.calibration_report import (
    region_figures,
    report_figures,
    report_judgement,
    weakest_region,
)

WIDTH, RADIUS, WALL, CENTRE, BASE = 840, 230, 60, 260, 280
LABELS, LABEL_STEP = 520, 48  # left edge of the errors beside the dome, and their distance
LINE_PX, WRAP = 20, 92
COLOURS = {Verdict.OK: "#1a7f4b", Verdict.WARN: "#9a6a00"}
FULL_COLOUR_MM = 1.0  # mean error that is drawn in full red
EMPTY, GRID = "#e4e4e4", "#888888"
STYLE = "text{font:14px sans-serif;fill:#222}.verdict{font-weight:700}.name{fill:#666}.pointer{stroke:#888}"


def report_svg(calibration: Calibration) -> str:
    """Return the picture as the text of an SVG file."""
    regions = calibration.source.regions
    judgement = report_judgement(calibration)
    lines = textwrap.wrap(f"{judgement.verdict.value}: {judgement.text}", WRAP)
    top = LINE_PX * (len(lines) + 1)
    body = [
        _text(20, LINE_PX * (number + 1), line, f'class="verdict" style="fill:{COLOURS[judgement.verdict]}"')
        for number, line in enumerate(lines)
    ]
    figures = report_figures(calibration)
    if regions:
        body += [f'<g transform="translate(0 {top})">', *_dome(regions), "</g>"]
        top += BASE + 2 * LINE_PX
        figures = [pair for pair in figures if pair not in region_figures(regions)]
    for number, (name, value) in enumerate(figures):
        y = top + LINE_PX * (number + 1)
        body += [_text(20, y, name, 'class="name"'), _text(230, y, value)]
    height = top + LINE_PX * (len(figures) + 2)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}">',
            f'<style>{STYLE}</style><rect width="{WIDTH}" height="{height}" fill="white"/>',
            *body,
            "</svg>\n",
        ]
    )


def _dome(regions: Sequence[RegionErrors]) -> list[str]:
    """Draw each region as a band of the dome seen from the side, on both sides, with its errors beside it."""
    drawn = []
    weakest = weakest_region(regions)
    for number, (region, (name, errors)) in enumerate(zip(regions, region_figures(regions), strict=True)):
        colour = _colour(region.mean_mm) if region.presses else EMPTY
        for side in (1, -1):
            path = _band(region.low_deg, region.high_deg, side)
            drawn.append(f'<path d="{path}" fill="{colour}" stroke="{GRID}"/>')
        x, y = _at(RADIUS, (region.low_deg + region.high_deg) / 2, 1)
        mark = ' class="verdict"' if region is weakest else ""
        label = BASE - LABEL_STEP * (number + 0.5)
        drawn.append(f'<path d="M {x:.1f} {y:.1f} L {LABELS - 5} {label:.1f}" class="pointer"/>')
        drawn.append(_text(LABELS, label - 2, name.removesuffix(" above the base"), mark))
        drawn.append(_text(LABELS, label + 14, errors, mark))
    return drawn


def _band(low_deg: float, high_deg: float, side: int) -> str:
    """Return the path of a band of the wall between two angles above the base."""
    corners = [
        _at(radius, angle, side)
        for radius, angle in (
            (RADIUS, low_deg),
            (RADIUS, high_deg),
            (RADIUS - WALL, high_deg),
            (RADIUS - WALL, low_deg),
        )
    ]
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners
    sweep, back = (0, 1) if side > 0 else (1, 0)
    inner = RADIUS - WALL
    return (
        f"M {ax:.1f} {ay:.1f} A {RADIUS} {RADIUS} 0 0 {sweep} {bx:.1f} {by:.1f} "
        f"L {cx:.1f} {cy:.1f} A {inner} {inner} 0 0 {back} {dx:.1f} {dy:.1f} Z"
    )


def _at(radius: float, above_base_deg: float, side: int) -> tuple[float, float]:
    angle = math.radians(above_base_deg)
    return CENTRE + side * radius * math.cos(angle), BASE - radius * math.sin(angle)


def _colour(mean_mm: float) -> str:
    """Return green for no error to red for `FULL_COLOUR_MM`."""
    share = min(1.0, mean_mm / FULL_COLOUR_MM)
    return f"hsl({120 * (1 - share):.0f} 60% 62%)"


def _text(x: float, y: float, text: str, attributes: str = "") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" {attributes}>{escape(text)}</text>'
