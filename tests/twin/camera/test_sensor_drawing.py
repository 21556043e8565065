"""Construction plan of the press sample's sensor, and its table in docs/building.md."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

from palpate_edge.datasets.sensor_file import read_sensor
from palpate_edge.geometry.sensor import Markers, Ring, Sensor
from palpate_twin.camera.sensor_drawing import closest_beads_mm, draw_sensor, half_view_deg, ring_plans
from palpate_twin.cli.sensor import sensor

ROOT = Path(__file__).resolve().parents[3]
SENSOR_TOML = ROOT / "demo" / "recording" / "press" / "sensor.toml"


@pytest.fixture
def sample() -> Sensor:
    return read_sensor(SENSOR_TOML)


def test_a_ring_at_30_deg_stands_at_half_the_radius(sample: Sensor) -> None:
    """sin 30 deg is 0.5; the chord between 12 beads is 2 sin 15 deg times the circle's radius."""
    plan = next(plan for plan in ring_plans(sample) if plan.theta_deg == 30)
    assert plan.circle_radius_mm == pytest.approx(13.25)
    assert plan.height_mm == pytest.approx(22.950, abs=0.001)
    assert plan.spacing_mm == pytest.approx(6.859, abs=0.001)


def test_beads_on_a_circle_are_closest_along_their_chord(sample: Sensor) -> None:
    equator = Markers(radius_mm=10.0, diameter_mm=1.0, rings=(Ring(90.0, 6),))
    hexagon = Sensor(sample.dome, equator, sample.camera)
    assert closest_beads_mm(hexagon) == pytest.approx(10.0)


def test_the_camera_sees_the_whole_base(sample: Sensor) -> None:
    """The half angle of a pinhole camera is atan 320/380."""
    assert half_view_deg(sample.camera) == pytest.approx(40.10, abs=0.01)


def test_the_command_prints_the_plan_and_draws_every_bead(tmp_path: Path) -> None:
    picture = tmp_path / "plan.svg"
    done = CliRunner().invoke(sensor, [str(SENSOR_TOML), "--picture", str(picture)])
    assert done.exit_code == 0, done.output
    assert "85 of 3 mm, centres on 26.5 mm: 2 mm of silicone over them, 0 mm behind" in done.output
    assert len(re.findall(r"^ +\d+  +\d+ ", done.output, re.MULTILINE)) == 6
    ElementTree.parse(picture)
    beads_of_section, beads_of_layout = 2 * 6, 85
    assert picture.read_text().count("fill: #bf360c") == beads_of_section + beads_of_layout


def test_the_same_sensor_gives_the_same_picture(sample: Sensor, tmp_path: Path) -> None:
    for name in ("one.svg", "two.svg"):
        draw_sensor(sample, tmp_path / name)
    assert (tmp_path / "one.svg").read_bytes() == (tmp_path / "two.svg").read_bytes()


def test_a_sensor_without_rings_says_how_its_layout_is_found(sample: Sensor, tmp_path: Path) -> None:
    text = re.sub(r"rings = \[.*?\n\]", "", SENSOR_TOML.read_text(), flags=re.DOTALL)
    (tmp_path / "sensor.toml").write_text(text)
    done = CliRunner().invoke(sensor, [str(tmp_path / "sensor.toml"), "--picture", str(tmp_path / "a.png")])
    assert done.exit_code == 0, done.output
    assert "no rings: the layout is learned from the first frame" in done.output


def test_the_table_of_the_page_is_what_the_command_prints() -> None:
    page = (ROOT / "docs" / "building.md").read_text()
    printed = CliRunner().invoke(sensor, [str(SENSOR_TOML)]).output
    assert printed.strip() in page
