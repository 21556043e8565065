"""Reconstruct the hand's modes, orientation error and joint torques from a bus log.

Modes are not on the bus; the host records them in the log. In a log without records, replaying the log
through a host core reproduces them. Replayed ticks have the phase of the host's heartbeat; where a tick of
the host was late, such a replay differs by one or two ticks. Torques are the target torques of RPDO 1 in the
log, scaled by the rated torque that the drive reported.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate_bus.eds.cia402 import Controlword
from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus, Matrix
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.axis_master import AxisMaster
from palpate_host.drives.command_frames import torque_commands
from palpate_host.drives.drive import Drive, needs_of
from palpate_host.drives.registry import make_drives
from palpate_host.service.host_core import HostCore
from palpate_host.service.host_records import TickRecord
from palpate_host.service.replay import first_beat_us, has_reads, steps
from palpate_twin.demo.distribution import Distribution, distribution
from palpate_twin.demo.programme import SentCommand

STEP_TOLERANCE_NM = 1e-9
HALF_TICK_US = 500  # half a period of the fastest host: tolerance between replayed and real ticks


@dataclass(frozen=True, slots=True)
class HostTick:
    """One tick of the replayed host. R_c: estimated orientation of the object, R_d: desired orientation."""

    time_us: int
    mode: Mode
    reason: str
    orientation_error_deg: float | None
    R_c: Matrix | None = None
    R_d: Matrix | None = None


@dataclass(frozen=True, slots=True)
class TimedMode:
    """A change of mode, `time_s` after the log's first frame."""

    time_s: float
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True)
class JointTorque:
    """Torque commands of one joint over the run: stamps_us (n,), torque_Nm (n,)."""

    name: str
    limit_Nm: float
    stamps_us: Array
    torque_Nm: Array


@dataclass(frozen=True, slots=True)
class JointFigures:
    """Torque figures of one joint. largest_Nm: largest absolute command; over_limit: count above limit_Nm."""

    name: str
    limit_Nm: float
    largest_Nm: float
    commands: int
    over_limit: int


@dataclass(frozen=True, slots=True)
class HandFigures:
    """Figures of the hand over a run. orientation_error_deg: error in mode MANIPULATE."""

    mode_s: dict[str, float]
    changes: tuple[TimedMode, ...]
    orientation_error_deg: Distribution | None
    joints: tuple[JointFigures, ...]


def joint_torques(records: Sequence[LogRecord], config: HandConfig) -> list[JointTorque]:
    """Return the commanded torques of every joint in the log.

    Raises BusError for a frame that does not match the EDS, ConfigError if the log lacks the rated torque of
    a drive.
    """
    drives = make_drives(needs_of(config))
    drives_by_id: dict[int, list[Drive]] = {}
    for drive in drives:
        for can_id in drive.receive_ids:
            drives_by_id.setdefault(can_id, []).append(drive)
    rpdos = torque_commands(config)
    commands: list[list[tuple[int, int]]] = [[] for _ in drives]
    for record in records:
        can_id = record.frame.can_id
        if can_id in drives_by_id:
            for drive in drives_by_id[can_id]:
                drive.receive(record.stamp_us, record.frame)
        elif can_id in rpdos:
            for index, per_mille in rpdos[can_id].per_mille(record.frame.data).items():
                commands[index].append((record.stamp_us, per_mille))
    result = []
    for joint, drive, stamped in zip(config.joints, drives, commands, strict=True):
        if not isinstance(drive, AxisMaster) or drive.scale is None:
            raise ConfigError(f"the log has no rated torque of the {drive.name}: record a run from its start")
        torque = [joint.direction * drive.scale.to_Nm(per_mille) for _, per_mille in stamped]
        stamps = np.array([stamp_us for stamp_us, _ in stamped], dtype=np.float64)
        result.append(JointTorque(joint.name, joint.torque_limit_Nm, stamps, np.array(torque)))
    return result


def replay_modes(
    records: Sequence[LogRecord], config: HandConfig, hand: HandKinematics, sent: Sequence[SentCommand] = ()
) -> list[HostTick]:
    """Replay the log through a host core; return its ticks from the first heartbeat to the end of the stop.

    sent: commands that the host accepted during the run. Raises ConfigError if the log has no heartbeat of
    the host.
    """
    if first_beat_us(records, config) is None:
        raise ConfigError("the log has no heartbeat of the host: record a run from its start")
    core = HostCore(config, hand, verifies=has_reads(records, config))
    stop_us = _operator_stop_us(records, config)
    commands = deque(sent)

    def apply_commands(now_us: int) -> None:
        if now_us >= stop_us:
            core.request_stop()
        while commands and commands[0].after_us < now_us - HALF_TICK_US:
            core.command(commands.popleft().rotate)

    replayed = steps(records, config, hand, core, apply_commands)
    return [
        _host_tick(step.now_us, step.output.status) for step in replayed if step.output.status is not None
    ]


def recorded_modes(ticks: Sequence[TickRecord]) -> list[HostTick]:
    """Return the ticks that the host recorded in the log; none in a log of an older palpate."""
    return [_host_tick(tick.status.time_us, tick.status) for tick in ticks]


def _host_tick(now_us: int, status: HostStatus) -> HostTick:
    error_deg = status.orientation_error_deg
    return HostTick(now_us, status.mode, status.reason, error_deg, status.R_c, status.R_d)


def _operator_stop_us(records: Sequence[LogRecord], config: HandConfig) -> float:
    """Return the time of the host's first quick stop, or infinity.

    The operator's stop command is not on the bus, so it is inferred from the quick stop. If a fault caused
    the stop, the replay detects the fault by itself.
    """
    cob_id, command = next(iter(torque_commands(config).items()))
    for record in records:
        if record.frame.can_id == cob_id:
            word = command.controlword(record.frame.data, 0)
            if word == Controlword.QUICK_STOP:
                return record.stamp_us
    return math.inf


def hand_figures(ticks: Sequence[HostTick], torques: Sequence[JointTorque], begin_us: int) -> HandFigures:
    """Return the figures of the hand. begin_us: time stamp of the log's first frame."""
    errors = [
        tick.orientation_error_deg
        for tick in ticks
        if tick.mode is Mode.MANIPULATE and tick.orientation_error_deg is not None
    ]
    return HandFigures(
        mode_s=_seconds_in_modes(ticks),
        changes=_changes(ticks, begin_us),
        orientation_error_deg=distribution(errors),
        joints=tuple(_joint_figures(torque) for torque in torques),
    )


def _seconds_in_modes(ticks: Sequence[HostTick]) -> dict[str, float]:
    seconds: dict[str, float] = {}
    for tick, following in pairwise(ticks):
        mode = tick.mode.value
        seconds[mode] = seconds.get(mode, 0.0) + (following.time_us - tick.time_us) / 1e6
    return seconds


def _changes(ticks: Sequence[HostTick], begin_us: int) -> tuple[TimedMode, ...]:
    changes: list[TimedMode] = []
    for tick in ticks:
        if not changes or changes[-1].mode is not tick.mode:
            changes.append(TimedMode((tick.time_us - begin_us) / 1e6, tick.mode, tick.reason))
    return tuple(changes)


def _joint_figures(torque: JointTorque) -> JointFigures:
    sizes = np.abs(torque.torque_Nm)
    return JointFigures(
        name=torque.name,
        limit_Nm=torque.limit_Nm,
        largest_Nm=float(sizes.max(initial=0.0)),
        commands=len(sizes),
        over_limit=int((sizes > torque.limit_Nm + STEP_TOLERANCE_NM).sum()),
    )
