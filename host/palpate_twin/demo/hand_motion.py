"""What the hand did, from its bus log: modes and orientation error, torques and their limits.

Modes are not on the bus. The host's core is a function of its frames and ticks alone, so they are what it
answers when the log is replayed through it, with ticks in the phase the host had; where the host's own tick
was late, the replay is a tick or two off. Torques are those of the log: target torque of each RPDO 1, scaled
by what the drive said of itself.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate_bus.eds.cia402 import CIA402_EDS, Controlword
from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.eds import load_eds
from palpate_edge.node.pdo_codec import PdoDirection, pdo_codec
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus, Matrix
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.cia402 import Cia402Drive
from palpate_host.drives.cia402_modes import CONTROLWORD, TARGET_TORQUE
from palpate_host.drives.drive import needs_of
from palpate_host.service.host_core import HostCore
from palpate_host.service.replay import first_beat_us, steps
from palpate_twin.demo.distribution import Distribution, distribution
from palpate_twin.demo.programme import Given

STEP_TOLERANCE_NM = 1e-9
HALF_TICK_US = 500  # of the fastest host: a replayed tick may lie a little before or after the real one


@dataclass(frozen=True, slots=True)
class Moment:
    """One tick of the replayed host. R_c, R_d: where it believes the object and where it wants it."""

    time_us: int
    mode: Mode
    reason: str
    orientation_error_deg: float | None
    R_c: Matrix | None = None
    R_d: Matrix | None = None


@dataclass(frozen=True, slots=True)
class TimedMode:
    """A mode as entered, `time_s` after the log's first frame."""

    time_s: float
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True)
class JointTorque:
    """What was asked of one joint over the run: stamps_us (n,), torque_Nm (n,)."""

    name: str
    limit_Nm: float
    stamps_us: Array
    torque_Nm: Array


@dataclass(frozen=True, slots=True)
class JointFigures:
    """largest_Nm: of all commands, without sign; over_limit: commands beyond the limit."""

    name: str
    limit_Nm: float
    largest_Nm: float
    commands: int
    over_limit: int


@dataclass(frozen=True, slots=True)
class HandFigures:
    """orientation_error_deg: while the hand turns the object by contacts (mode MANIPULATE)."""

    mode_s: dict[str, float]
    changes: tuple[TimedMode, ...]
    orientation_error_deg: Distribution | None
    joints: tuple[JointFigures, ...]


def joint_torques(records: Sequence[LogRecord], config: HandConfig) -> list[JointTorque]:
    """Every joint's commanded torque in the log.

    Raises BusError for a frame that is not the EDS's, ConfigError when a drive was never identified.
    """
    drives = [Cia402Drive(needs) for needs in needs_of(config)]
    drive_of = {can_id: drive for drive in drives for can_id in drive.receive_ids}
    codecs = [
        pdo_codec(load_eds(CIA402_EDS, joint.drive_node), PdoDirection.RECEIVE, 1) for joint in config.joints
    ]
    joint_of = {codec.cob_id: index for index, codec in enumerate(codecs)}
    commands: list[list[tuple[int, int]]] = [[] for _ in codecs]
    for record in records:
        can_id = record.frame.can_id
        if can_id in drive_of:
            drive_of[can_id].receive(record.stamp_us, record.frame)
        elif can_id in joint_of:
            index = joint_of[can_id]
            per_mille = codecs[index].decode(record.frame.data)[TARGET_TORQUE]
            commands[index].append((record.stamp_us, per_mille))
    result = []
    for joint, drive, told in zip(config.joints, drives, commands, strict=True):
        if drive.scale is None:
            raise ConfigError(f"the log has no rated torque of the {drive.name}: record a run from its start")
        torque = [joint.direction * drive.scale.to_Nm(per_mille) for _, per_mille in told]
        stamps = np.array([stamp_us for stamp_us, _ in told], dtype=np.float64)
        result.append(JointTorque(joint.name, joint.torque_limit_Nm, stamps, np.array(torque)))
    return result


def replay_modes(
    records: Sequence[LogRecord], config: HandConfig, hand: HandKinematics, given: Sequence[Given] = ()
) -> list[Moment]:
    """The host's ticks over the log, from its first heartbeat to the end of the stop. given: the commands
    that it obeyed meanwhile.

    Raises ConfigError when the log has no heartbeat of the host.
    """
    if first_beat_us(records, config) is None:
        raise ConfigError("the log has no heartbeat of the host: record a run from its start")
    core = HostCore(config, hand)
    stop_us = _operator_stop_us(records, config)
    commands = deque(given)

    def tell(now_us: int) -> None:
        if now_us >= stop_us:
            core.request_stop()
        while commands and commands[0].after_us < now_us - HALF_TICK_US:
            core.command(commands.popleft().rotate)

    taken = steps(records, config, hand, core, tell)
    return [_moment(step.now_us, step.output.status) for step in taken if step.output.status is not None]


def _moment(now_us: int, status: HostStatus) -> Moment:
    error_deg = status.orientation_error_deg
    return Moment(now_us, status.mode, status.reason, error_deg, status.R_c, status.R_d)


def _operator_stop_us(records: Sequence[LogRecord], config: HandConfig) -> float:
    """When the host first commanded a quick stop; infinity when it never did.

    It does so for the operator, whose wish is not on the bus, or for a fault, which the replay finds itself.
    """
    codec = pdo_codec(load_eds(CIA402_EDS, config.joints[0].drive_node), PdoDirection.RECEIVE, 1)
    for record in records:
        if record.frame.can_id == codec.cob_id:
            word = codec.decode(record.frame.data)[CONTROLWORD]
            if word == Controlword.QUICK_STOP:
                return record.stamp_us
    return math.inf


def hand_figures(moments: Sequence[Moment], torques: Sequence[JointTorque], begin_us: int) -> HandFigures:
    """The figures of the hand; `begin_us` is the log's first stamp."""
    errors = [
        moment.orientation_error_deg
        for moment in moments
        if moment.mode is Mode.MANIPULATE and moment.orientation_error_deg is not None
    ]
    return HandFigures(
        mode_s=_seconds_in_modes(moments),
        changes=_changes(moments, begin_us),
        orientation_error_deg=distribution(errors),
        joints=tuple(_joint_figures(torque) for torque in torques),
    )


def _seconds_in_modes(moments: Sequence[Moment]) -> dict[str, float]:
    seconds: dict[str, float] = {}
    for moment, following in pairwise(moments):
        mode = moment.mode.value
        seconds[mode] = seconds.get(mode, 0.0) + (following.time_us - moment.time_us) / 1e6
    return seconds


def _changes(moments: Sequence[Moment], begin_us: int) -> tuple[TimedMode, ...]:
    changes: list[TimedMode] = []
    for moment in moments:
        if not changes or changes[-1].mode is not moment.mode:
            changes.append(TimedMode((moment.time_us - begin_us) / 1e6, moment.mode, moment.reason))
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
