"""rig.toml: the printer, the scale, the probe, and what the printer may do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from palpate_edge.common.config_file import Strict, read_toml
from palpate_edge.common.contact import Vector3
from palpate_edge.common.errors import ConfigError

Positive = Annotated[float, msgspec.Meta(gt=0)]
Baud = Annotated[int, msgspec.Meta(ge=1200, le=4_000_000)]


class PrinterConfig(Strict, frozen=True):
    """The printer. start: G-code lines sent before the first move; silence_s: longest time without a byte
    while the printer owes a reply."""

    port: str
    baud: Baud = 115_200
    start: tuple[str, ...] = ()
    travel_mm_s: Positive = 60.0
    press_mm_s: Positive = 5.0
    silence_s: Annotated[float, msgspec.Meta(ge=3, le=600)] = 10.0


class ScaleConfig(Strict, frozen=True):
    """The scale. unit_N: newtons of one unit of its output, negative if pressing lowers the reading;
    settling: readings after a move that do not count; silence_s: longest time without a reading."""

    port: str
    baud: Baud = 115_200
    unit_N: float = 0.00980665
    settling: Annotated[int, msgspec.Meta(ge=0, le=100)] = 4
    silence_s: Annotated[float, msgspec.Meta(ge=0.2, le=60)] = 2.0


class BoxConfig(Strict, frozen=True):
    """Corners of the box that the printer's position never leaves, in the printer's coordinates."""

    low_mm: Vector3
    high_mm: Vector3


class ProbeConfig(Strict, frozen=True):
    """The ball and what holds it: a shaft no thicker than the ball, under a tool head that is taken as a
    cylinder. shaft_mm: from the ball's centre to the underside of the head."""

    ball_radius_mm: Positive = 5.0
    shaft_mm: Positive = 40.0
    head_radius_mm: Positive = 40.0


class FixtureConfig(Strict, frozen=True):
    """The holder of the fingertip: everything below top_mm, measured from the dome's centre, within radius_mm
    of its axis."""

    radius_mm: Positive = 60.0
    top_mm: float = 0.0


class PressConfig(Strict, frozen=True):
    """The presses. apex_mm: the printer's position, within 5 mm, where the ball just touches the apex.

    force_N: a press ends at this normal force; stop_N: the run stops at this force on the scale, and sends an
    emergency stop at twice it. friction: largest coefficient of friction between ball and skin.
    """

    apex_mm: Vector3
    depth_mm: Positive = 3.5
    slide: Annotated[float, msgspec.Meta(ge=0, le=0.4)] = 0.3
    theta_deg: Annotated[float, msgspec.Meta(ge=10, le=80)] = 70.0
    force_N: Positive = 4.0
    stop_N: Positive = 6.0
    touch_N: Annotated[float, msgspec.Meta(ge=0.01, le=1)] = 0.08
    friction: Annotated[float, msgspec.Meta(gt=0, le=3)] = 1.0


class RigConfig(Strict, frozen=True):
    """The content of rig.toml."""

    printer: PrinterConfig
    scale: ScaleConfig
    box: BoxConfig
    presses: PressConfig
    probe: ProbeConfig = ProbeConfig()
    fixture: FixtureConfig = FixtureConfig()


def read_rig(path: Path) -> RigConfig:
    """Read a rig.toml. Raises ConfigError with file, key and what is allowed."""
    rig = read_toml(path, RigConfig, guide="docs/press-rig.md lists every key")
    low, high, apex = rig.box.low_mm, rig.box.high_mm, rig.presses.apex_mm
    for axis, least, most, at in zip("xyz", low, high, apex, strict=True):
        if not least < most:
            raise ConfigError(
                f"{path}: box.low_mm must be less than box.high_mm in {axis}: {least} and {most}"
            )
        if not least < at < most:
            raise ConfigError(
                f"{path}: presses.apex_mm: {axis} = {at} is outside of the box, {least} to {most}"
            )
    if rig.presses.stop_N <= rig.presses.force_N:
        raise ConfigError(
            f"{path}: presses.stop_N = {rig.presses.stop_N} must be more than presses.force_N = "
            f"{rig.presses.force_N}"
        )
    if rig.scale.unit_N == 0:
        raise ConfigError(f"{path}: scale.unit_N = 0: give the newtons of one unit of the scale's output")
    return rig
