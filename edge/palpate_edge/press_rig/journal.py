"""The journal of a run, ``press-rig.json`` beside the frames: what was pressed, and what the scale weighed.

It is written whole after each press, so that a break of any kind loses at most the press under way.
"""

from __future__ import annotations

from pathlib import Path

import msgspec

from palpate_edge.common.atomic_write import write_atomically
from palpate_edge.common.config_file import read_json
from palpate_edge.common.contact import Vector3
from palpate_edge.common.errors import ConfigError, DatasetError
from palpate_edge.geometry.sensor import Sensor
from palpate_edge.press_rig.plan import PlanSettings
from palpate_edge.press_rig.rig_config import RigConfig

JOURNAL = "press-rig.json"


class PressRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One frame that was taken.

    index: in the plan. outward: of the contact, in the printer's axes, None without contact. weight_N: the
    part of the contact's force that presses down on the scale; weight_sd_N: its standard error.
    """

    index: int
    frame: str
    split: str
    time_s: float
    outward: Vector3 | None
    depth_mm: float
    slide_mm: tuple[float, float]
    weight_N: float
    weight_sd_N: float


class RigJournal(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A run: the sensor's fingerprint, the plan, the ball, the friction assumed, and the frames taken."""

    sensor: str
    plan: PlanSettings
    ball_radius_mm: float
    friction: float
    records: tuple[PressRecord, ...] = ()

    @property
    def done(self) -> frozenset[int]:
        """Return the indices of the frames that were taken."""
        return frozenset(record.index for record in self.records)


def new_journal(rig: RigConfig, sensor: Sensor, presses: int, test_presses: int, seed: int) -> RigJournal:
    """Return the journal of a run that has not begun."""
    limits = rig.presses
    plan = PlanSettings(presses, test_presses, seed, limits.theta_deg, limits.depth_mm, limits.slide)
    return RigJournal(sensor.fingerprint(), plan, rig.probe.ball_radius_mm, limits.friction)


def write_journal(folder: Path, journal: RigJournal) -> None:
    """Replace the journal of a dataset's folder. Raises DatasetError when the disk refuses."""
    data = msgspec.json.format(msgspec.json.encode(journal), indent=1)
    write_atomically(folder / JOURNAL, data + b"\n", DatasetError)


def read_journal(folder: Path) -> RigJournal | None:
    """Return a folder's journal; None when there is none. Raises ConfigError for a damaged one."""
    path = folder / JOURNAL
    if not path.exists():
        return None
    return read_json(path, RigJournal, guide="start a run in a new folder")


def continued(found: RigJournal | None, fresh: RigJournal, folder: Path) -> RigJournal:
    """Return the journal to go on with. Raises ConfigError when the folder holds a run of other settings."""
    if found is None:
        return fresh
    for name, before, now in (
        ("sensor.toml", found.sensor, fresh.sensor),
        ("the plan", found.plan, fresh.plan),
        ("probe.ball_radius_mm", found.ball_radius_mm, fresh.ball_radius_mm),
    ):
        if before != now:
            raise ConfigError(
                f"{folder} holds a run with another value of {name}: repeat the options of that run, or give "
                "a new folder"
            )
    return found
