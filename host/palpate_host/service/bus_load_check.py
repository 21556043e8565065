"""The load that a hand's ticks put on its bus: a hand whose frames do not fit is refused before it starts."""

from __future__ import annotations

import math
from dataclasses import replace

from palpate_bus.load.budget import BudgetCase, budget
from palpate_edge.common.errors import ConfigError
from palpate_host.config.hand_config import HandConfig

CAN_DRIVE = "cia402"
FEWEST_TICKS_HZ = 10


def check_bus_load(config: HandConfig) -> None:
    """Raise ConfigError when the frames of hand.toml's ticks exceed the bit rate with all their stuff bits.

    Counted: the fingertips at 30 frames a second, the `cia402` drives, SYNC, heartbeats (`palpate-host bus
    budget`). A full bus delays SYNC and torques until the grasp oscillates.
    """
    tick_Hz = config.control.tick_Hz
    case = _case(config)
    worst = budget(case).worst_percent
    if worst <= 100.0:
        return
    idle = budget(replace(case, tick_Hz=0.0)).worst_percent
    largest_Hz = math.floor((100.0 - idle) / (worst - idle) * tick_Hz)
    way_out = f"set control.tick_Hz to {largest_Hz} at most" if largest_Hz >= FEWEST_TICKS_HZ else ""
    raise ConfigError(
        f"{tick_Hz} ticks a second load the bus of {config.bus.bitrate / 1000:g} kbit/s to {worst:.0f} % with"
        f" {len(config.fingers)} fingertips and {case.drives} drives:"
        f" {way_out or 'use a faster bus or fewer nodes'} (palpate-host bus budget shows the frames)"
    )


def _drives(config: HandConfig) -> int:
    return sum(joint.drive == CAN_DRIVE and joint.axis is None for joint in config.joints)


def _case(config: HandConfig) -> BudgetCase:
    return BudgetCase(
        fingertips=len(config.fingers),
        joints=_drives(config),
        tick_Hz=config.control.tick_Hz,
        bitrate=config.bus.bitrate,
        data_bitrate=config.bus.data_bitrate,
        classic_drives=True,
        axis_nodes=tuple(len(axes) for axes in config.node_axes.values()),
    )
