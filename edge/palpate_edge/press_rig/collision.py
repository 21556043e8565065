"""Collision checks: a move is refused when ball, head or fixture could meet, or the box would be left."""

from __future__ import annotations

import math

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_edge.press_rig.dome_place import DomePlace
from palpate_edge.press_rig.rig_config import RigConfig

CLEARANCE_MM = 1.0  # of the ball from the fixture, and of the head from the dome
STEP_MM = 0.5  # between the checked positions of a move
ROUNDING_MM = 1e-6


def fault_of(position_mm: Array, rig: RigConfig, place: DomePlace, dome_radius_mm: float) -> str | None:
    """Return what is wrong with a printer position (3,), None for an allowed one."""
    x, y, z = position_mm.tolist()
    low, high = rig.box.low_mm, rig.box.high_mm
    for axis, at, least, most in zip("xyz", (x, y, z), low, high, strict=True):
        if not least - ROUNDING_MM <= at <= most + ROUNDING_MM:
            return f"{axis} = {at:.2f} mm leaves the box, {least:g} to {most:g} mm"
    centre_x, centre_y, centre_z = place.centre_mm
    aside_mm, above_mm = math.hypot(x - centre_x, y - centre_y), z - centre_z
    ball_mm = rig.probe.ball_radius_mm
    if (
        aside_mm < rig.fixture.radius_mm + ball_mm
        and above_mm - ball_mm < rig.fixture.top_mm + CLEARANCE_MM - ROUNDING_MM
    ):
        return "the ball would touch the fixture"
    head_mm = above_mm + rig.probe.shaft_mm - CLEARANCE_MM  # the head's underside over the dome's centre
    widest_mm = math.sqrt(max(0.0, dome_radius_mm**2 - max(0.0, head_mm) ** 2))
    if head_mm < dome_radius_mm and aside_mm < rig.probe.head_radius_mm + widest_mm:
        return "the tool head would touch the dome"
    deepest_mm = rig.presses.depth_mm + 1.0
    if place.depth_mm(position_mm) > deepest_mm:
        return f"the ball would be more than {deepest_mm:g} mm deep in the dome"
    return None


def check_move(
    start_mm: Array, end_mm: Array, rig: RigConfig, place: DomePlace, dome_radius_mm: float
) -> None:
    """Refuse a straight move between printer positions (3,). Raises ConfigError with the reason."""
    count = max(1, math.ceil(float(np.linalg.norm(end_mm - start_mm)) / STEP_MM))
    for share in np.linspace(0, 1, count + 1):
        fault = fault_of(start_mm + share * (end_mm - start_mm), rig, place, dome_radius_mm)
        if fault is not None:
            target = ", ".join(f"{value:.1f}" for value in end_mm)
            raise ConfigError(
                f"the move to {target} mm is refused: {fault}; correct box, probe, fixture or presses "
                "in rig.toml"
            )
