"""Runs of a whole hand in lock step, recorded as the demo records them, and the comparison of an export with
the run.

The expected values are the statuses that the host published while it ran, and RPDO 1 as it is decoded here.
"""

from __future__ import annotations

import csv
import struct
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result

from palpate_bus.logs.candump import LogRecord, read_log, write_log
from palpate_host.cli.main import cli
from palpate_host.common.command import Grasp, Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.packaged import MODELS
from palpate_host.control.kinematics import HandKinematics
from palpate_host.service.contract import recording_header
from palpate_host.service.host import load_hand
from palpate_host.service.host_records import HostRecorder
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.paper.trial import make_engine

WIDE = MODELS / "table4-wide.toml"
CALIBRATION = "{number}123456789abcdef"
RPDO_1 = 0x200
AXIS_RPDO_BYTES = 4
"""Controlword and target torque of an axis of a drive node with several (docs/drives.md)."""
AXIS_OBJECTS = 0x800
"""From an object of an axis to that of the next (CiA 402)."""


@dataclass(frozen=True, slots=True)
class Run:
    """A recorded run: its hand.toml, its bus log, and what its host published."""

    hand_toml: Path
    log: Path
    config: HandConfig
    hand: HandKinematics
    statuses: list[HostStatus]
    commands: int


def record_run(folder: Path, seed: int, seconds: float) -> Run:
    """Grasp, turn by random angles at random times, stop; everything follows from the seed."""
    dice = Random(seed)

    def operate(loop: LockstepLoop) -> int:
        commands, elapsed_s = 0, 0.0
        while elapsed_s < seconds:
            step_s = dice.uniform(0.05, 0.3)
            loop.run(step_s)
            elapsed_s += step_s
            if loop.status is not None and loop.status.mode in (Mode.MANIPULATE, Mode.GRASP, Mode.HOLD):
                axis = dice.randrange(3)
                rpy_deg = [0.0, 0.0, 0.0]
                rpy_deg[axis] = round(dice.uniform(-25, 25), 3)
                loop.host.command(
                    Grasp() if dice.random() < 0.2 else Rotate(tuple(rpy_deg), dice.uniform(0.2, 1))
                )
                commands += 1
        return commands

    return record(folder, WIDE.read_text(), seed, operate)


def record(
    folder: Path, text: str, seed: int, operate: Callable[[LockstepLoop], int], *, has_weight: bool = False
) -> Run:
    """Record a run of the hand in this text of a hand.toml, to which each fingertip's calibration is added.

    operate: runs the loop, and returns the number of its commands; the hand is stopped afterwards.
    """
    for number in range(1, text.count("fingertip_node = ") + 1):
        name = f'name = "finger-{number}"'
        assert name in text
        text = text.replace(name, f'{name}\ncalibration = "{CALIBRATION.format(number=number - 1)}"', 1)
    hand_toml = folder / "hand.toml"
    hand_toml.write_text(text)
    config, hand = load_hand(hand_toml)
    contacts = TrueContactSource(1e3 * config.control.tip_radius_m, 0.1, seed)
    records: list[LogRecord] = []
    statuses: list[HostStatus] = []
    loop = LockstepLoop(
        *(config, hand, make_engine(config, "mujoco", has_B=False), contacts),
        has_weight=has_weight,
        on_frame=lambda stamp_us, frame: records.append(LogRecord(stamp_us, frame)),
        on_tick=statuses.append,
    )
    commands = operate(loop)
    loop.host.request_stop()
    loop.run(1.0)
    assert loop.is_over
    recorder = HostRecorder(config)
    notes = [note for status in statuses for note in recorder.notes(status)]
    write_log(folder / "bus.log", recording_header(config), records, notes)
    return Run(hand_toml, folder / "bus.log", config, hand, statuses, commands)


def replay(run: Run, log: Path | None = None, hand_toml: Path | None = None) -> Result:
    """Run `palpate-host replay` on the run's log, or on another one."""
    arguments = ["replay", str(log or run.log), "--config", str(hand_toml or run.hand_toml)]
    return CliRunner().invoke(cli, arguments)


def check_export(run: Run, output: Path) -> None:
    """Export to CSV: mode and orientation error are the run's own, `action` is RPDO 1 of every tick."""
    done = CliRunner().invoke(
        cli, ["export", str(run.log), "--config", str(run.hand_toml), "-o", str(output)]
    )
    assert done.exit_code == 0, done.stderr
    with output.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(run.statuses)
    for row, status in zip(rows, run.statuses, strict=True):
        assert row["mode"] == status.mode.value
        error = status.orientation_error_deg
        assert row["orientation_error_deg"] == ("" if error is None else repr(error))
    commanded, rated_Nm = rpdo_1_of_ticks(run), rated_torques_Nm(run)
    for row, per_mille in zip(rows, commanded, strict=True):
        for joint in run.config.joints:
            text, axis = row[f"action.{joint.name}"], (joint.drive_node, joint.axis or 0)
            assert (text == "") == (axis not in per_mille)
            if axis in per_mille:
                torque_Nm = joint.direction * per_mille[axis] * rated_Nm[axis] / 1000
                assert float(text) == pytest.approx(torque_Nm)
    assert any(number for per_mille in commanded for number in per_mille.values())


def rpdo_1_of_ticks(run: Run) -> list[dict[tuple[int, int], int]]:
    """Return the target torque in thousandths by node and axis, for each SYNC of the log."""
    ticks: list[dict[tuple[int, int], int]] = []
    has_axes = run.config.node_axes
    for record in read_log(run.log).records:
        node, data = record.frame.can_id - RPDO_1, record.frame.data
        if record.frame.can_id == 0x080:
            ticks.append({})
        elif node in has_axes:
            for axis in range(len(data) // AXIS_RPDO_BYTES):
                ticks[-1][node, axis] = struct.unpack_from("<Hh", data, AXIS_RPDO_BYTES * axis)[1]
        elif 1 <= node <= len(run.config.joints):
            ticks[-1][node, 0] = struct.unpack("<Hbh", data)[2]
    return ticks


def rated_torques_Nm(run: Run) -> dict[tuple[int, int], float]:
    """Return the rated torque by node and axis, from the responses to the uploads of 6076h (CiA 301)."""
    found = {}
    for record in read_log(run.log).records:
        node, data = record.frame.can_id - 0x580, record.frame.data
        if 1 <= node <= len(run.config.joints) and data[0] == 0x43:
            axis, rest = divmod(int.from_bytes(data[1:3], "little") - 0x6076, AXIS_OBJECTS)
            if rest == 0 and axis >= 0:
                found[node, axis] = int.from_bytes(data[4:], "little") / 1000
    return found
