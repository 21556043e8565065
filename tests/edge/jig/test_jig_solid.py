"""The jig as OpenSCAD renders it, read from the STL file: closed, and free along each hole's planned axis."""

from __future__ import annotations

import math
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.cli.jig import jig
from palpate_edge.jig.jig_plan import Hole, JigSize
from palpate_edge.jig.jig_table import read_jig_table

RADIUS_MM = 30.0
SENSOR = Path(__file__).parents[3] / "demo/recording/press/sensor.toml"  # a dome of 30 mm
SIZE = JigSize(2 * RADIUS_MM, rod_mm=14.0, largest_theta_deg=40.0)  # seven holes; more only take longer
FACETS = 12
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("openscad") is None, reason="openscad is missing: make system-deps"),
]


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, tuple[Hole, ...]]:
    """Return the triangles (n, 3, 3) in mm, and the holes of jig.csv."""
    folder = tmp_path_factory.mktemp("jig")
    source, solid = folder / "jig.scad", folder / "jig.stl"
    sizes = ["--rod", str(SIZE.rod_mm), "--largest-theta", str(SIZE.largest_theta_deg)]
    CliRunner().invoke(jig, [str(SENSOR), "-o", str(source), *sizes], catch_exceptions=False)
    command = ["openscad", "-q", "--hardwarnings", "-D", f"$fn={FACETS}", "-o", str(solid), str(source)]
    subprocess.run(command, check=True, timeout=1800)
    lines = (line.split() for line in solid.read_text().splitlines())
    corners = [[float(value) for value in words[1:]] for words in lines if words and words[0] == "vertex"]
    return np.array(corners).reshape(-1, 3, 3), read_jig_table(folder / "jig.csv")


def winding(triangles: np.ndarray, point: np.ndarray) -> int:
    """Return 1 inside of a closed surface, 0 outside: the solid angle of van Oosterom and Strackee."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    ab, bc, ca = ((u * v).sum(axis=1) for u, v in ((a, b), (b, c), (c, a)))
    above = (a * np.cross(b, c)).sum(axis=1)
    below = la * lb * lc + ab * lc + bc * la + ca * lb
    return round(float(np.arctan2(above, below).sum() / (2 * math.pi)))


def around(hole: Hole, along_mm: float, across_mm: float) -> list[np.ndarray]:
    """Six points around a hole's axis, at a distance from the dome's centre along it and across it."""
    axis = np.array(hole.outward)
    aside = np.cross(axis, [0.6, 0.8, 0.0])
    aside /= np.linalg.norm(aside)
    turns = np.arange(6) * math.pi / 3 + 0.1
    return [
        along_mm * axis + across_mm * (np.cos(t) * aside + np.sin(t) * np.cross(axis, aside)) for t in turns
    ]


def test_the_surface_is_closed_and_every_edge_joins_two_triangles(printed):
    triangles, _ = printed
    edges = [(a, b) for t in triangles.tolist() for a, b in pairwise([*map(tuple, t), tuple(t[0])])]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    signed = (triangles[:, 0] * np.cross(triangles[:, 1], triangles[:, 2])).sum()
    assert signed > 0  # faces look outward


def test_the_dome_has_room_and_the_skirt_stands_on_the_table(printed):
    triangles, _ = printed
    assert triangles[..., 2].min() == pytest.approx(-SIZE.skirt_mm, abs=1e-4)
    nearest = np.linalg.norm(triangles.mean(axis=1), axis=1)
    assert nearest[triangles.mean(axis=1)[:, 2] > 0].min() > RADIUS_MM


def test_each_hole_is_free_along_its_planned_axis_with_a_wall_around_it(printed):
    triangles, holes = printed
    narrow = math.cos(math.pi / FACETS)  # of the polygon's inner radius
    inner, outer = RADIUS_MM + SIZE.gap_mm, RADIUS_MM + SIZE.gap_mm + SIZE.wall_mm + SIZE.guide_mm
    for hole in holes:
        for along in (inner + 1.2, outer - 1.0):
            for point in around(hole, along, SIZE.hole_mm / 2 * narrow - 0.05):
                assert winding(triangles, point) == 0, hole
            for wall in (0.1, SIZE.wall_mm * 0.8):
                for point in around(hole, along, SIZE.hole_mm / 2 + wall * narrow):
                    assert winding(triangles, point) == 1, (hole, along, wall)
        for along in (0.0, inner - 3.0, outer + 1.0):  # the rod reaches the dome, and a hand the rod
            assert winding(triangles, along * np.array(hole.outward)) == 0, hole
