"""The plan of a jig's holes and its table, by the geometry of the sphere."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from click.testing import CliRunner

from palpate_edge.cli.jig import jig
from palpate_edge.common.errors import ConfigError, DatasetError
from palpate_edge.jig.jig_plan import JigSize, plan_holes
from palpate_edge.jig.jig_table import jig_table_text, read_jig_table


@pytest.mark.parametrize(("radius_mm", "rod_mm"), [(30.0, 10.0), (20.0, 10.0), (15.0, 5.0), (36.0, 6.0)])
def test_guides_do_not_meet_and_holes_leave_walls(radius_mm, rod_mm):
    size = JigSize(2 * radius_mm, rod_mm=rod_mm)
    holes = plan_holes(radius_mm, size)
    assert [hole.number for hole in holes] == list(range(1, len(holes) + 1))
    assert holes[0].outward == (0, 0, 1)
    nearest_rad = min(np.arccos(np.dot(a.outward, b.outward)) for a, b in combinations(holes, 2))
    inner_mm = radius_mm + size.gap_mm
    assert 2 * (inner_mm + size.wall_mm) * np.sin(nearest_rad / 2) >= size.guide_diameter_mm
    assert 2 * inner_mm * np.sin(nearest_rad / 2) - size.hole_mm >= 2 * size.wall_mm


def test_a_rod_too_thick_for_the_dome_is_refused():
    with pytest.raises(ConfigError, match="a rod of 30 mm is too thick for a dome of 10 mm"):
        plan_holes(10.0, JigSize(20.0, rod_mm=30.0))


def test_the_command_writes_source_and_table_of_the_same_holes(drawn_dataset, tmp_path):
    source = tmp_path / "jig.scad"
    words = [str(drawn_dataset / "sensor.toml"), "-o", str(source), "--rod", "6", "--skirt", "20"]
    result = CliRunner().invoke(jig, words, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    holes = read_jig_table(tmp_path / "jig.csv")
    text = source.read_text()
    assert "rod_mm = 6;" in text and "skirt_mm = 20;" in text
    for hole in holes:
        assert f"    [{hole.number}, {hole.theta_deg:g}, {hole.phi_deg:g}],\n" in text
    assert (tmp_path / "jig.csv").read_text() == jig_table_text(holes)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("hole,theta\n", "the first line must be hole,theta_deg,phi_deg"),
        ("hole,theta_deg,phi_deg\n", "has no hole: write it with palpate-edge jig"),
        ("hole,theta_deg,phi_deg\none,0,0\n", "line 2: hole = one is not a number"),
        ("hole,theta_deg,phi_deg\n1,95,0\n", "line 2: theta_deg = 95 is out of range"),
        ("hole,theta_deg,phi_deg\n1,30\n", "line 2 has 2 fields, not 3"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, text, said):
    path = tmp_path / "jig.csv"
    path.write_text(text)
    with pytest.raises(DatasetError, match=said):
        read_jig_table(path)
