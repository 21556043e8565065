"""Replay of a bus log through HostCore on a virtual clock: the same frames in give the same frames out.

Inputs are the log's frames that other nodes sent, at their time stamps. Ticks run when the core requests
them; where the recorded host's SYNC paused for more than two ticks, the next tick is as late as that SYNC.
This is all that a log without the host's records allows; recorded_replay.py repeats a run with its commands.
A log is bound to its contract (contract.py).
"""

from __future__ import annotations

from bisect import bisect
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median

from palpate_bus.logs.candump import LogHeader, LogRecord, write_log
from palpate_bus.logs.log_files import read_any_log
from palpate_edge.common.contact_quantities import BASE_TPDOS, FD_TPDO
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip_objects import EXPOSURE_TIME, LATENCY
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.pdo_codec import PdoCodec, PdoDirection, pdo_codec
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.identify import SDO_REQUEST_ID
from palpate_host.network.fingertips import unwrap_us
from palpate_host.network.nmt_master import HEARTBEAT_ID, SYNC
from palpate_host.network.node_contract import reads_contract
from palpate_host.service.contract import check_contract, frames_header
from palpate_host.service.host_core import HostCore, HostOutput
from palpate_host.service.host_records import TickRecord, missing_events, missing_ticks, read_ticks

FOREIGN_FORMATS = (".asc", ".blf")
NO_HOST = "the host's records: commands, modes and orientation errors"
"""The missing part of a log into which no host or recorder of palpate wrote notes."""
EXPOSURE_TPDOS = (BASE_TPDOS[-1], FD_TPDO)
"""The TPDOs that carry the exposure time of a contact, on a classic and on a CAN FD bus."""


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


@dataclass(frozen=True, slots=True)
class HandLog:
    """A bus log of a hand. ticks: the host's records, none in a log of another recorder or of format 1.
    lacks: what the log does not contain, a line each. header: empty for ASC and BLF.
    """

    records: tuple[LogRecord, ...]
    ticks: tuple[TickRecord, ...]
    lacks: tuple[str, ...]
    header: LogHeader


def read_hand_log(log_path: Path, config: HandConfig) -> HandLog:
    """Read a log of this hand.

    Raises LogError when it cannot be read, ConfigError when it belongs to another
    contract. ASC and BLF files have no contract, and their time has another zero: their stamps are moved to
    the bus clock.
    """
    log = read_any_log(log_path)
    if log_path.suffix.lower() in FOREIGN_FORMATS:
        records = on_bus_clock(log.records, [finger.fingertip_node for finger in config.fingers])
        return HandLog(records, (), ("its contract: which hand made it", NO_HOST), log.header)
    lacks = check_contract(log_path, log.header, config)
    ticks = tuple(read_ticks(log_path, log.notes))
    if not ticks:
        lacks = (*lacks, NO_HOST)
    for gaps, what in ((missing_ticks(ticks), "ticks"), (missing_events(ticks), "commands or other events")):
        if gaps:
            number = sum(count for _, count in gaps)
            lacks = (*lacks, f"{number} of the host's {what}, the first before {gaps[0][0] / 1e6:.6f}")
    return HandLog(log.records, ticks, lacks, log.header)


def read_bound_log(log_path: Path, config: HandConfig) -> tuple[LogRecord, ...]:
    """Read the frames of a log of this hand. Raises as `read_hand_log`."""
    return read_hand_log(log_path, config).records


def exposure_codecs(fingertips: Sequence[int]) -> dict[int, PdoCodec]:
    """Return the codecs of the TPDOs with exposure time and latency of these nodes, by identifier."""
    ods = [load_eds(FINGERTIP_EDS, node) for node in fingertips]
    codecs = [pdo_codec(od, PdoDirection.TRANSMIT, number) for od in ods for number in EXPOSURE_TPDOS]
    return {codec.cob_id: codec for codec in codecs}


def exposure_of(codec: PdoCodec, record: LogRecord) -> tuple[int, int]:
    """Return exposure time on the bus clock and latency, both in us, of a frame of `exposure_codecs`."""
    values = codec.layout.unpack(record.frame.data)
    return unwrap_us(values[EXPOSURE_TIME, 0], record.stamp_us), values[LATENCY, 0]


def on_bus_clock(records: Sequence[LogRecord], fingertips: Sequence[int]) -> tuple[LogRecord, ...]:
    """Shift the stamps so that TPDO 3 or 10 arrives at its exposure time plus its latency.

    The zero of a recorder's time may differ from that of the bus clock, which is known modulo 2^32 us only.
    Without either the records are returned unchanged.
    """
    codecs, shifts = exposure_codecs(fingertips), []
    for record in records:
        codec = codecs.get(record.frame.can_id)
        if codec is not None and len(record.frame.data) >= codec.length_bytes:
            exposed_us, latency_us = exposure_of(codec, record)
            shifts.append(exposed_us + latency_us - record.stamp_us)
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
    return Replay(frames_header(config), tuple(answers), taken, tuple(changes), failure, status)


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
