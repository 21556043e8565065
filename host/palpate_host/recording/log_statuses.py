"""The host's status of each tick from a bus log: from the recorded frames and the host's records in it.

Joints, contacts and torques are decoded from the frames, the commanded torque from RPDO 1 of the tick. Mode,
orientations and counters are the host's records. Nothing is computed by a second run of the host: in a log
without records, mode and orientations are unknown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from palpate_bus.logs.candump import LogRecord
from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import BusError
from palpate_host.common.command import Recover
from palpate_host.common.joint_command import Follows
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, FingerStatus, HostStatus, JointStatus, matrix
from palpate_host.common.tick_inputs import BusLost, BusRestored, HostEvent
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.control.virtual_frame import FrameError, virtual_frame
from palpate_host.drives.axis_master import AxisMaster
from palpate_host.drives.command_frames import torque_commands
from palpate_host.network.nmt_master import SYNC
from palpate_host.network.nodes import Nodes
from palpate_host.service.host_records import TickRecord
from palpate_host.service.replay import HandLog


def log_statuses(log: HandLog, config: HandConfig, hand: HandKinematics) -> Iterator[HostStatus]:
    """Yield the status of each recorded tick in which the bus was up.

    A log without the host's records has a tick for each SYNC, at its time stamp; what only the host knew is
    then empty or None, and counters are 0."""
    commands = _Commands(log.records, config)
    nodes = _NodeStates(log.records, config, hand)
    if not log.ticks:
        for sync in commands.syncs:
            nodes.take_until(sync.stamp_us)
            yield nodes.status(_unknown(sync.stamp_us), commands.after(sync), None)
        return
    ticks = iter(log.ticks)
    syncs = iter(commands.syncs)
    sent: int | None = None
    for tick in ticks:
        nodes.take(tick)
        before, sent = sent, tick.status.counters.frames_out
        if before is None:  # the first tick of the log sends frames, unless the bus was lost
            before = sent - 1 if nodes.is_up else sent
        if sent == before:
            continue
        own = next((one for one in syncs if one.stamp_us >= tick.inputs.called_us), None)
        torque_Nm = [None] * len(config.joints) if own is None else commands.after(own)
        yield nodes.status(tick.status, torque_Nm, tick)


def _unknown(time_us: int) -> HostStatus:
    return HostStatus(
        time_us=time_us,
        mode=Mode.UNKNOWN,
        reason="",
        warning="",
        fingers=(),
        joints=(),
        R_vir=None,
        R_c=None,
        R_d=None,
        R_d_vir=None,
        orientation_error_deg=None,
        fit_residual_deg=None,
        target_rpy_deg=None,
        last_emergency="",
        counters=Counters(),
        turned=None,
    )


class _Commands:
    """RPDO 1 of each tick. syncs: the host's SYNCs, one a tick; RPDO 1 of the tick follows its SYNC."""

    def __init__(self, records: Sequence[LogRecord], config: HandConfig) -> None:
        self.syncs = [record for record in records if record.frame == SYNC]
        self._joints = config.joints
        has_torque = config.control.drives_follow is Follows.TORQUE
        commands = torque_commands(config) if has_torque else {}
        self._per_mille: dict[int, list[int | None]] = {}
        current: list[int | None] = [None] * len(config.joints)
        for record in records:
            if record.frame == SYNC:
                current = self._per_mille[id(record)] = [None] * len(config.joints)
            elif record.frame.can_id in commands:
                try:
                    targets = commands[record.frame.can_id].per_mille(record.frame.data)
                except BusError:  # of a length that is not the EDS's
                    continue
                for joint, target in targets.items():
                    current[joint] = target

    def after(self, sync: LogRecord) -> list[int | None]:
        """Return the target torque of each joint in 1/1000 of the rated torque; None without an RPDO 1."""
        return self._per_mille[id(sync)]


class _NodeStates:
    """The nodes as the frames in the log describe them."""

    def __init__(self, records: Sequence[LogRecord], config: HandConfig, hand: HandKinematics) -> None:
        self._config, self._hand = config, hand
        self._nodes = Nodes(config, hand, verifies=False)
        wanted = set(self._nodes.accept_ids)
        self._frames = [record for record in records if record.frame.can_id in wanted]
        self._place = 0
        self.is_up = True
        self._restored_us = 0

    def take(self, tick: TickRecord) -> None:
        """Take the frames that the host had taken before this tick, and the events that reset the nodes."""
        upto = self._end(tick.inputs.until_us)
        begin = self._place
        for given in tick.inputs.events:
            self._receive(min(upto, begin + given.after))
            self._apply(given.event)
        self._receive(upto)
        if self.is_up:
            self._nodes.tick(tick.status.time_us)

    def take_until(self, time_us: int) -> None:
        """Take the frames up to this time, which is that of a tick."""
        self._receive(self._end(time_us))
        self._nodes.tick(time_us)

    def status(
        self, known: HostStatus, per_mille: Sequence[int | None], tick: TickRecord | None
    ) -> HostStatus:
        """Return `known` with joints, fingers and R_vir."""
        nodes = self._nodes
        angles = nodes.drives.angles()
        R_vir: Array | None = None
        if angles is not None:
            try:
                R_vir = virtual_frame(self._hand.tip_centres_m(angles[0]))
            except FrameError:
                R_vir = None
        return replace(
            known,
            fingers=self._fingers(known.time_us, tick),
            joints=self._joints(per_mille, tick),
            R_vir=matrix(R_vir),
            last_emergency=known.last_emergency or nodes.last_emergency,
            inputs=None if tick is None else tick.inputs,
        )

    def _fingers(self, time_us: int, tick: TickRecord | None) -> tuple[FingerStatus, ...]:
        found = tuple(finger.status(time_us) for finger in self._nodes.fingers)
        if tick is None:
            return found
        pairs = zip(found, tick.unpaired, strict=True)
        return tuple(replace(finger, unpaired=unpaired) for finger, unpaired in pairs)

    def _joints(self, per_mille: Sequence[int | None], tick: TickRecord | None) -> tuple[JointStatus, ...]:
        """Return the joints. A drive of a recorded run begins with torque 0, as in the host."""
        recorded_Nm = None if tick is None else tick.command_Nm
        drives = self._nodes.drives
        found = []
        for index, (joint, drive) in enumerate(zip(self._config.joints, drives.drives, strict=True)):
            command_Nm = None if recorded_Nm is None else recorded_Nm[index]
            number = per_mille[index]
            if recorded_Nm is None and number is not None and isinstance(drive, AxisMaster) and drive.scale:
                command_Nm = joint.direction * drive.scale.to_Nm(number)
            state = drive.joint
            found.append(
                JointStatus(
                    name=joint.name,
                    position_rad=None if state is None else state.position_rad,
                    velocity_rad_s=None if state is None else state.velocity_rad_s,
                    command_Nm=command_Nm,
                    torque_Nm=drive.torque_Nm if drive.is_identified or tick is not None else None,
                    drive_state=drive.state_name,
                )
            )
        return tuple(found)

    def _end(self, time_us: int) -> int:
        place = self._place
        while place < len(self._frames) and self._frames[place].stamp_us <= time_us:
            place += 1
        return place

    def _receive(self, upto: int) -> None:
        for record in self._frames[self._place : upto]:
            if self.is_up and record.stamp_us >= self._restored_us:
                self._nodes.receive(record.stamp_us, record.frame)
        self._place = max(self._place, upto)

    def _apply(self, event: HostEvent) -> None:
        match event:
            case BusLost():
                self.is_up = False
                self._nodes.bus_lost()
            case BusRestored(at_us=at_us):
                self.is_up, self._restored_us = True, at_us
            case Recover():
                self._nodes.recover()
            case _:
                pass
