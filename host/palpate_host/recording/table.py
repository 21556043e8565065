"""The host's status as rows, one a tick, with the columns of LeRobot's datasets.

timestamp (s from the first row), frame_index, episode_index, index, task_index; observation.state.JOINT
(rad), observation.velocity.JOINT (rad/s), observation.effort.JOINT (N m), action.JOINT (commanded torque,
N m); observation.tactile.FINGER.x_mm, .y_mm, .z_mm, .fn_N, .fx_N, .fy_N (empty when not known),
.in_contact, .slip; mode; observation.QUANTITY.FINGER of each further quantity (contact_quantities.py);
orientation_error_deg (from R_vir to R_d_vir); observation.friction_ratio.FINGER, observation.friction.FINGER
and observation.friction_margin.FINGER; grip_N; object_x_mm, object_y_mm, object_z_mm, object_place95_mm,
object_orientation95_deg; load_x_N, load_y_N, load_z_N. A cell is empty when it is not known.
"""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from palpate_edge.common.atomic_write import atomic_text
from palpate_edge.common.contact_quantities import QUANTITIES, Quantity
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import FingerStatus, HostStatus

Cell = float | int | str | bool | None

TACTILE = tuple(quantity for quantity in QUANTITIES if quantity.in_tactile_vector)
ADDED = tuple(quantity for quantity in QUANTITIES if not quantity.in_tactile_vector)
"""Columns at the end of the row, one a finger: those before them are a contract."""


def rows(statuses: Iterable[HostStatus]) -> Iterator[dict[str, Cell]]:
    """Yield one row for each status, all with the same columns."""
    first_us: int | None = None
    for number, status in enumerate(statuses):
        first_us = status.time_us if first_us is None else first_us
        row: dict[str, Cell] = {
            "timestamp": (status.time_us - first_us) * 1e-6,
            "frame_index": number,
            "episode_index": 0,
            "index": number,
            "task_index": 0,
        }
        for joint in status.joints:
            row[f"observation.state.{joint.name}"] = joint.position_rad
            row[f"observation.velocity.{joint.name}"] = joint.velocity_rad_s
            row[f"observation.effort.{joint.name}"] = joint.torque_Nm
            row[f"action.{joint.name}"] = joint.command_Nm
        for finger in status.fingers:
            row |= _tactile(finger)
        row["mode"] = status.mode.value
        for quantity in ADDED:
            for finger in status.fingers:
                row |= _measured(finger, [quantity])
        row["orientation_error_deg"] = status.orientation_error_deg
        yield row | _hold(status)


def _tactile(finger: FingerStatus) -> dict[str, Cell]:
    flags = {"in_contact": finger.in_contact, "slip": finger.slip}
    return _measured(finger, TACTILE) | {
        f"observation.tactile.{finger.name}.{name}": flag for name, flag in flags.items()
    }


def _measured(finger: FingerStatus, quantities: Iterable[Quantity]) -> dict[str, Cell]:
    """Return the columns of `quantities` for one finger; empty without a valid contact."""
    known = finger.valid and finger.in_contact
    return {row.recording_column(finger.name): row.of(finger) if known else None for row in quantities}


def _hold(status: HostStatus) -> dict[str, Cell]:
    """Return the columns of friction, grip, pose and load; empty where the status lacks them."""

    def known(name: str) -> Any:
        return None if status.hold is None else getattr(status.hold, name)

    row: dict[str, Cell] = {}
    for name in ("friction_ratio", "friction", "friction_margin"):
        values = known(name) or (None,) * len(status.fingers)
        for finger, value in zip(status.fingers, values, strict=True):
            row[f"observation.{name}.{finger.name}"] = value
    row["grip_N"] = known("grip_N")
    for axis, value in zip("xyz", known("place_mm") or (None,) * 3, strict=True):
        row[f"object_{axis}_mm"] = value
    row["object_place95_mm"] = known("place95_mm")
    row["object_orientation95_deg"] = known("orientation95_deg")
    for axis, value in zip("xyz", known("load_N") or (None,) * 3, strict=True):
        row[f"load_{axis}_N"] = value
    return row


def write_csv(path: Path, statuses: Iterable[HostStatus]) -> int:
    """Write one row per status; return their number. Raises ConfigError when the file system refuses."""
    table = rows(statuses)
    count = 0
    with atomic_text(path, ConfigError) as file:
        for first in table:
            writer = csv.DictWriter(file, first)
            writer.writeheader()
            writer.writerow(first)
            count = 1
            for row in table:
                writer.writerow(row)
                count += 1
    return count
