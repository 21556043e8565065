"""Limits of the printer: the box, collisions of ball, head and fixture, the plan, and rig.toml."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from palpate_edge.common.errors import ConfigError
from palpate_edge.press_rig.collision import check_move, fault_of
from palpate_edge.press_rig.dome_place import DomePlace
from palpate_edge.press_rig.plan import PlanSettings, make_plan
from palpate_edge.press_rig.rig_config import (
    BoxConfig,
    PressConfig,
    PrinterConfig,
    ProbeConfig,
    RigConfig,
    ScaleConfig,
    read_rig,
)

RADIUS_MM = 30.0
PLACE = DomePlace((100.0, 100.0, 20.0), 35.0)


def _rig(shaft_mm: float = 40.0, head_mm: float = 40.0) -> RigConfig:
    return RigConfig(
        printer=PrinterConfig(port="p"),
        scale=ScaleConfig(port="s"),
        box=BoxConfig(low_mm=(40.0, 40.0, 20.0), high_mm=(160.0, 160.0, 90.0)),
        presses=PressConfig(apex_mm=(100.0, 100.0, 55.0)),
        probe=ProbeConfig(shaft_mm=shaft_mm, head_radius_mm=head_mm),
    )


def _fault(x: float, y: float, z: float, rig: RigConfig | None = None) -> str:
    return fault_of(np.array([x, y, z]), rig or _rig(), PLACE, RADIUS_MM) or ""


def test_presses_all_over_the_dome_are_allowed() -> None:
    for theta_deg in (0, 40, 70):
        for depth_mm in (-2.0, 3.5):
            assert not _fault(*PLACE.ball_mm(math.radians(theta_deg), 1.0, depth_mm))


@pytest.mark.parametrize(
    ("position", "fault"),
    [
        ((100.0, 100.0, 91.0), "z = 91.00 mm leaves the box, 20 to 90 mm"),
        ((39.0, 100.0, 80.0), "x = 39.00 mm leaves the box"),
        ((140.0, 100.0, 25.0), "the ball would touch the fixture"),
        ((100.0, 100.0, 50.0), "more than 4.5 mm deep"),
    ],
)
def test_a_forbidden_position_has_a_reason(position: tuple[float, float, float], fault: str) -> None:
    assert fault in _fault(*position)


def test_a_short_shaft_brings_the_head_to_the_dome() -> None:
    """Ball at 70 deg: 12 mm over the centre, 33 mm aside; a head on 15 mm of shaft is at 27 mm, below the
    apex at 30 mm, and 40 mm wide."""
    position = PLACE.ball_mm(math.radians(70), 0.0, 0.0)
    assert "tool head" in _fault(*position, _rig(shaft_mm=15.0))
    assert not _fault(*position, _rig(shaft_mm=15.0, head_mm=15.0))  # beside the dome: 33 mm - 13 mm - 15 mm


def test_a_move_through_the_dome_is_refused_though_its_ends_are_allowed() -> None:
    start, end = PLACE.ball_mm(1.1, 0.0, -2.0), PLACE.ball_mm(1.1, math.pi, -2.0)
    with pytest.raises(ConfigError, match=r"refused: the ball would be more than 4.5 mm deep"):
        check_move(start, end, _rig(), PLACE, RADIUS_MM)
    over = np.array([0.0, 0.0, 40.0])
    check_move(start + over, end + over, _rig(), PLACE, RADIUS_MM)


def test_the_plan_covers_the_cap_evenly_and_repeats() -> None:
    settings = PlanSettings(200, 20, 0, 70.0, 3.5, 0.3)
    plan = make_plan(settings)
    assert plan == make_plan(settings)
    presses = [press for press in plan if press.depth_mm > 0]
    assert [sum(press.split == split for press in presses) for split in ("train", "test")] == [200, 20]
    assert len(plan) - len(presses) == 22
    heights = np.sort([math.cos(press.theta_rad) for press in presses])
    assert np.abs(np.diff(heights)).max() < 2 * (1 - math.cos(math.radians(70))) / 220  # uniform in area
    assert abs(np.mean([press.outward[:2] for press in presses])) < 0.01
    for press in presses:
        assert 0.35 <= press.depth_mm <= 3.5
        assert math.hypot(*press.slide_mm) <= 0.3 * press.depth_mm + 1e-9
    # Each block of 40 covers the dome, so that an interrupted run has presses everywhere.
    assert max(press.theta_rad for press in presses[:40]) > math.radians(60)
    assert min(press.theta_rad for press in presses[:40]) < math.radians(20)


GOOD = """
[printer]
port = "/dev/ttyUSB0"
[scale]
port = "/dev/ttyUSB1"
[box]
low_mm = [40.0, 40.0, 20.0]
high_mm = [160.0, 160.0, 90.0]
[presses]
apex_mm = [100.0, 100.0, 55.0]
"""


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("", ""), None),
        (("55.0", "95.0"), "presses.apex_mm: z = 95.0 is outside of the box"),
        (("90.0", "20.0"), "box.low_mm must be less than box.high_mm in z"),
        (("[presses]", "[presses]\nforce_N = 7.0"), "presses.stop_N = 6.0 must be more than"),
        (("[presses]", "[presses]\nforce = 7.0"), "unknown"),
        (('port = "/dev/ttyUSB1"', 'port = "/dev/ttyUSB1"\nunit_N = 0.0'), "scale.unit_N = 0"),
    ],
)
def test_rig_toml_is_checked(tmp_path: Path, change: tuple[str, str], message: str | None) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(GOOD.replace(*change))
    if message is None:
        assert read_rig(path).presses.force_N == 4.0
        return
    with pytest.raises(ConfigError, match=message):
        read_rig(path)
