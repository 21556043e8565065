"""Replay of a bus log through HostCore on a virtual clock: the same frames in give the same frames out.

Inputs are the log's frames that other nodes sent, at their time stamps. Ticks run when the core requests
them; where the recorded host's SYNC paused for more than two ticks, the next tick is as late as that SYNC. A
log is bound to its contract: the hash of each EDS and the node map in its header are checked.
"""

from __future__ import annotations

import hashlib
from bisect import bisect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from struct import Struct

from palpate_bus.eds.cia402 import CIA402_EDS
from palpate_bus.logs.candump import LogHeader, LogRecord, write_log
from palpate_bus.logs.log_files import read_any_log
from palpate_edge.common.errors import ConfigError
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.kinematics import HandKinematics
from palpate_host.network.fingertips import unwrap_us
from palpate_host.network.nmt_master import HEARTBEAT_ID, SYNC
from palpate_host.network.node_contract import reads_contract
from palpate_host.network.sdo_upload import SDO_REQUEST_ID
from palpate_host.service.host_core import HostCore, HostOutput

EDS_FILES = {"eds.fingertip": FINGERTIP_EDS, "eds.cia402": CIA402_EDS}
EDS_HASH_DIGITS = 16
FOREIGN_FORMATS = (".asc", ".blf")
TPDO_3_ID = 0x380
EXPOSURE = Struct("<IHH")  # TPDO 3: exposure time, sequence, latency


@dataclass(frozen=True, slots=True)
class ModeChange:
    """The host entered a mode. time_us: the tick's, epoch us."""

    time_us: int
    mode: Mode
    reason: str


@dataclass(frozen=True, slots=True)
class ReplayStep:
    """One call of the host. now_us: time of the call; taken: the frames of the log passed to it."""

    now_us: int
    taken: tuple[LogRecord, ...]
    output: HostOutput

    @property
    def answers(self) -> tuple[LogRecord, ...]:
        """The frames that the host sends at this tick."""
        return tuple(LogRecord(self.now_us, frame) for frame in self.output.frames_out)


@dataclass(frozen=True, slots=True)
class Replay:
    """The result of a replay. failure: why the host stopped, or empty; status: the last one."""

    header: LogHeader
    records: tuple[LogRecord, ...]
    frames_in: int
    changes: tuple[ModeChange, ...]
    failure: str
    status: HostStatus | None

    @property
    def modes(self) -> tuple[Mode, ...]:
        """The modes in the order in which they were entered."""
        return tuple(change.mode for change in self.changes)


def contract_header(config: HandConfig) -> LogHeader:
    """Return the header of a log of this hand: a hash of each EDS, and the device at each node id."""
    entries = {key: eds_hash(path) for key, path in EDS_FILES.items()}
    nodes = {joint.drive_node: f"drive:{joint.name}" for joint in config.joints}
    nodes |= {finger.fingertip_node: f"fingertip:{finger.name}" for finger in config.fingers}
    return LogHeader(entries | {f"node.0x{node:02X}": who for node, who in sorted(nodes.items())})


def eds_hash(path: Path) -> str:
    """Return the first 16 hexadecimal digits of the file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:EDS_HASH_DIGITS]


def check_contract(log_path: Path, header: LogHeader, config: HandConfig) -> None:
    """Check a log's header. Raises ConfigError with the key when the log has another EDS or node map."""
    for key, expected in contract_header(config).entries.items():
        found = header.entries.get(key)
        if found == expected:
            continue
        if found is None:
            raise ConfigError(
                f"{log_path}: its header has no {key}, so its EDS and nodes are unknown:"
                " record it with the --header options that `palpate-host contract` prints"
            )
        way_out = (
            "replay it with the palpate version that made it, or record it again"
            if key in EDS_FILES
            else "give the hand.toml that it was recorded with"
        )
        raise ConfigError(f"{log_path}: was made with {key} {found!r}, here it is {expected!r}: {way_out}")


def read_bound_log(log_path: Path, config: HandConfig) -> tuple[LogRecord, ...]:
    """Read the records of a log of this hand.

    Raises LogError when it cannot be read, ConfigError when it belongs to another contract. ASC and BLF files
    have no contract, and their time has another zero: their stamps are moved to the bus clock.
    """
    log = read_any_log(log_path)
    if log_path.suffix.lower() not in FOREIGN_FORMATS:
        check_contract(log_path, log.header, config)
        return log.records
    return on_bus_clock(log.records, [finger.fingertip_node for finger in config.fingers])


def on_bus_clock(records: Sequence[LogRecord], fingertips: Sequence[int]) -> tuple[LogRecord, ...]:
    """Shift the stamps so that TPDO 3 arrives at its exposure time plus its latency.

    The zero of a recorder's time may differ from that of the bus clock, which is known modulo 2^32 us only.
    Without TPDO 3 the records are returned unchanged.
    """
    ids = {TPDO_3_ID + node for node in fingertips}
    shifts = []
    for record in records:
        if record.frame.can_id in ids and len(record.frame.data) == EXPOSURE.size:
            exposed_us, _, latency_us = EXPOSURE.unpack(record.frame.data)
            shifts.append(unwrap_us(exposed_us, record.stamp_us) + latency_us - record.stamp_us)
    if not shifts:
        return tuple(records)
    shift_us = round(median(shifts))
    return tuple(replace(record, stamp_us=record.stamp_us + shift_us) for record in records)


def replay_to_log(log_path: Path, config: HandConfig, hand: HandKinematics) -> Replay:
    """Replay a log file. Raises as `read_bound_log`."""
    return replay(read_bound_log(log_path, config), config, hand)


def replay(
    records: Sequence[LogRecord], config: HandConfig, hand: HandKinematics, core: HostCore | None = None
) -> Replay:
    """Run `records` (at least one) through a fresh HostCore, or `core`; see `steps`."""
    return replay_steps(steps(records, config, hand, core), config)


def replay_steps(taken_steps: Iterable[ReplayStep], config: HandConfig) -> Replay:
    """Collect the result of the steps."""
    answers: list[LogRecord] = []
    changes: list[ModeChange] = []
    taken, failure, status = 0, "", None
    for step in taken_steps:
        taken += len(step.taken)
        answers += step.answers
        status, failure = step.output.status, step.output.failure
        if status is not None and (not changes or changes[-1].mode is not status.mode):
            changes.append(ModeChange(step.now_us, status.mode, status.reason))
    return Replay(contract_header(config), tuple(answers), taken, tuple(changes), failure, status)


def steps(
    records: Sequence[LogRecord],
    config: HandConfig,
    hand: HandKinematics,
    core: HostCore | None = None,
    before: Callable[[int], None] = lambda _: None,
) -> Iterator[ReplayStep]:
    """Yield the host's calls, from its first frame in the log to the log's last frame.

    Frames before the host's first heartbeat are not passed to it; a log without a host is replayed from its
    beginning. before: called with the time of each call, before it. The host verifies the fingertips if the
    recorded one did.
    """
    # A log holds no operator's commands.
    core = core or HostCore(config.starting(StartMode.AUTO), hand, verifies=has_reads(records, config))
    wanted = set(core.accept_ids)
    begin_us = first_beat_us(records, config)
    now_us = records[0].stamp_us if begin_us is None else begin_us
    end_us = records[-1].stamp_us
    stalls = [] if begin_us is None else _stalls(records, begin_us, 1_000_000 // config.control.tick_Hz)
    inputs = [r for r in records if r.frame.can_id in wanted and r.stamp_us >= now_us]
    taken = 0
    while True:
        upto = taken
        while upto < len(inputs) and inputs[upto].stamp_us <= now_us:
            upto += 1
        before(now_us)
        output = core.process(now_us, [(record.stamp_us, record.frame) for record in inputs[taken:upto]])
        yield ReplayStep(now_us, tuple(inputs[taken:upto]), output)
        taken = upto
        if output.finished or output.next_due_us > end_us:
            return
        now_us = _or_after_its_stall(output.next_due_us, stalls)


def has_reads(records: Iterable[LogRecord], config: HandConfig) -> bool:
    """Return whether the recorded host read the PDO parameters of a fingertip: those before 0.2 did not."""
    request_ids = {SDO_REQUEST_ID + finger.fingertip_node for finger in config.fingers}
    return any(r.frame.can_id in request_ids and reads_contract(r.frame.data) for r in records)


def first_beat_us(records: Iterable[LogRecord], config: HandConfig) -> int | None:
    """Return the time of the host's first heartbeat, sent in its first tick; None without a host in the
    log."""
    own_id = HEARTBEAT_ID + config.network.host_node
    return next((record.stamp_us for record in records if record.frame.can_id == own_id), None)


def _stalls(records: Iterable[LogRecord], begin_us: int, tick_us: int) -> list[tuple[int, int]]:
    """Return the intervals without a tick: those between two SYNCs of the host more than two ticks apart."""
    syncs = (r.stamp_us for r in records if r.frame.can_id == SYNC.can_id and r.stamp_us >= begin_us)
    return [(last + tick_us // 2, late) for last, late in pairwise(syncs) if late - last > 2 * tick_us]


def _or_after_its_stall(due_us: int, stalls: Sequence[tuple[int, int]]) -> int:
    before = bisect(stalls, (due_us, 0)) - 1
    return max(due_us, stalls[before][1]) if before >= 0 else due_us


def write_output(path: Path, result: Replay) -> None:
    """Write the host's frames as a candump log."""
    write_log(path, result.header, result.records)
