"""Replay of a run with its commands: the host runs again from the log, and each frame it sends is compared.

The host's records give the time of every tick, the last frame that the host had read, and each command with
its place among the frames, so the same build gives the same frames, also for a run whose ticks were late. The
first difference ends the replay."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from palpate_bus.decode.decoder import Decoder
from palpate_bus.decode.monitor_lines import line
from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import PalpateError
from palpate_host.common.tick_inputs import BusLost, BusRestored, End, HostEvent, Planned
from palpate_host.config.hand_config import HandConfig, StartMode
from palpate_host.control.kinematics import HandKinematics
from palpate_host.drives.drive_settings import RPDO_ID
from palpate_host.drives.identify import SDO_REQUEST_ID
from palpate_host.drives.registry import CIA402
from palpate_host.network.nmt_master import HEARTBEAT_ID, NMT_ID, SYNC, TIME_STAMP_ID
from palpate_host.service.contract import BUILD, build
from palpate_host.service.hand_devices import devices_of_hand
from palpate_host.service.host_core import HostCore
from palpate_host.service.host_records import TickRecord, counted_ids, missing_events, missing_ticks
from palpate_host.service.replay import HandLog, ReplayStep

OPEN_END_US = 100_000
"""Frames of the host's last ticks may be missing from a log that ends within this time after them."""


class ReplayDifferenceError(PalpateError):
    """A replay gives another frame than the log has, or the log lacks a part of the run."""

    exit_status = 10


def recorded_steps(
    log_path: Path, log: HandLog, config: HandConfig, hand: HandKinematics
) -> Iterator[ReplayStep]:
    """Yield the host's calls, one for each recorded tick, and compare the frames of each with the log.

    Raises ReplayDifferenceError at the first difference, with time, identifier, recorded and computed bytes
    and their meaning, and before the first step when the log does not contain the whole run."""
    ticks = log.ticks
    first = ticks[0].status
    if first.counters.ticks != 1:
        raise ReplayDifferenceError(
            f"{log_path}: begins at tick {first.counters.ticks} of the run, so a replay has no beginning:"
            " give the first piece of the recording"
        )
    for gaps, what in ((missing_ticks(ticks), "ticks"), (missing_events(ticks), "commands or other events")):
        if gaps:
            raise ReplayDifferenceError(
                f"{log_path}: {gaps[0][1]} of the host's {what} are missing before the tick at"
                f" {gaps[0][0] / 1e6:.6f}: give the log as it was recorded, or record the run again"
            )
    start = StartMode.COMMAND if ticks[0].inputs.waits else StartMode.AUTO
    core = HostCore(config.starting(start), hand)
    source = _Inputs(log_path, log.records, core.accept_ids)
    comparison = _Comparison(log_path, log, config)
    last_us = ticks[0].inputs.called_us
    for tick in ticks:
        taken = source.take(tick)
        place = 0
        for given in tick.inputs.events:
            upto = _place(taken, given.after, source.counted)
            core.process(last_us, [(record.stamp_us, record.frame) for record in taken[place:upto]])
            place = upto
            _apply(log_path, core, given.event, tick)
        now_us = tick.inputs.called_us
        output = core.process(now_us, [(record.stamp_us, record.frame) for record in taken[place:]])
        lost = any(isinstance(given.event, BusLost) for given in tick.inputs.events)
        comparison.add(now_us, output.frames_out, after_loss=lost)
        yield ReplayStep(now_us, tuple(taken), output)
        last_us = now_us
    comparison.finish()


class _Inputs:
    """The frames of other nodes, tick by tick."""

    def __init__(self, log_path: Path, records: Sequence[LogRecord], accept_ids: Sequence[int]) -> None:
        wanted, self.counted = set(accept_ids), counted_ids(accept_ids)
        self._log_path = log_path
        self._frames = [record for record in records if record.frame.can_id in wanted]
        self._place = 0
        self._has_begun = False

    def take(self, tick: TickRecord) -> list[LogRecord]:
        """Return the frames that the host took before this tick.

        Raises ReplayDifferenceError when the log has fewer or more than the host counted.
        """
        begin = self._place
        while self._place < len(self._frames) and self._frames[self._place].stamp_us <= tick.inputs.until_us:
            self._place += 1
        taken = self._frames[begin : self._place]
        count = sum(record.frame.can_id in self.counted for record in taken)
        if not self._has_begun and count > tick.inputs.taken:  # frames from before the host opened the bus
            keep = tick.inputs.taken
            while taken and (count := sum(r.frame.can_id in self.counted for r in taken)) > keep:
                taken = taken[1:]
        self._has_begun = self._has_begun or count > 0
        if count != tick.inputs.taken:
            what = "fewer" if count < tick.inputs.taken else "more"
            raise ReplayDifferenceError(
                f"{self._log_path}: the host took {tick.inputs.taken} frames before its tick at"
                f" {tick.status.time_us / 1e6:.6f}, the log has {count}, {what}: a frame of another node was"
                f" {'lost' if count < tick.inputs.taken else 'added'}; record the log again"
            )
        return taken


def _place(taken: Sequence[LogRecord], after: int, counted: frozenset[int]) -> int:
    """Return the place in `taken` after so many counted frames."""
    count = 0
    for place, record in enumerate(taken):
        if count == after:
            return place
        count += record.frame.can_id in counted
    return len(taken)


def _apply(log_path: Path, core: HostCore, event: HostEvent, tick: TickRecord) -> None:
    try:
        match event:
            case End(reason=reason):
                core.request_stop(reason)
            case BusLost(at_us=at_us, reason=reason):
                core.bus_lost(at_us, reason)
            case BusRestored(at_us=at_us):
                core.bus_restored(at_us)
            case Planned():
                core.planned(event)
            case _:
                core.command(event)
    except PalpateError as error:
        raise ReplayDifferenceError(
            f"{log_path}: the host accepted {type(event).__name__.lower()} before its tick at"
            f" {tick.status.time_us / 1e6:.6f}, the replay refuses it: {error}"
        ) from None


class _Comparison:
    """The host's frames as recorded and as computed, in their order on the bus."""

    def __init__(self, log_path: Path, log: HandLog, config: HandConfig) -> None:
        self._log_path, self._header = log_path, log.header
        self._decoder = Decoder(devices_of_hand(config))
        self._begin_us = log.records[0].stamp_us
        nodes = config.node_names
        own = {SYNC.can_id, TIME_STAMP_ID, HEARTBEAT_ID + config.network.host_node}
        own |= {RPDO_ID + joint.drive_node for joint in config.joints if joint.drive == CIA402}
        self._own = own  # identifiers of no other sender
        self._shared = {NMT_ID, *(SDO_REQUEST_ID + node for node in nodes)}  # other masters may send them
        begin_us = log.ticks[0].inputs.called_us
        self._recorded = [record for record in log.records if record.stamp_us >= begin_us]
        self._end_us = self._recorded[-1].stamp_us if self._recorded else begin_us
        self._place = 0
        self._waiting: list[tuple[int, CanFrame]] = []  # of the last tick, compared with the next

    def add(self, now_us: int, frames: Sequence[CanFrame], *, after_loss: bool) -> None:
        """Compare the frames of the tick before this one, unless the bus was lost meanwhile."""
        if after_loss:
            self._skip_lost()
        for stamp_us, frame in self._waiting:
            self._compare(stamp_us, frame)
        self._waiting = [(now_us, frame) for frame in frames]

    def finish(self) -> None:
        """Compare the last tick's frames; frames beyond them are a difference."""
        for stamp_us, frame in self._waiting:
            self._compare(stamp_us, frame)
        extra = self._next(self._own)
        if extra is not None:
            raise self._difference(extra.stamp_us, extra, None)

    def _compare(self, now_us: int, frame: CanFrame) -> None:
        if frame.can_id not in self._shared:
            self._own.add(frame.can_id)  # of a drive with a protocol of its own
        passed: LogRecord | None = None
        place = self._place
        while (record := self._next(self._own | self._shared)) is not None:
            if record.frame == frame:
                self._place += 1
                return
            if record.frame.can_id in self._own:
                break
            if passed is None and record.frame.can_id == frame.can_id:
                passed = record
            self._place += 1
        if record is None and passed is None and now_us >= self._end_us - OPEN_END_US:
            self._place = place
            return
        raise self._difference(now_us, passed or record, frame)

    def _next(self, ids: set[int]) -> LogRecord | None:
        while self._place < len(self._recorded):
            record = self._recorded[self._place]
            if record.frame.can_id in ids:
                return record
            self._place += 1
        return None

    def _skip_lost(self) -> None:
        """Keep of the frames before a loss of the bus those that were still sent."""
        kept = []
        place = self._place
        for stamp_us, frame in self._waiting:
            record = self._next(self._own)
            if record is None or record.frame != frame:
                break
            kept.append((stamp_us, frame))
            self._place += 1
        self._place, self._waiting = place, kept

    def _difference(
        self, now_us: int, recorded: LogRecord | None, computed: CanFrame | None
    ) -> ReplayDifferenceError:
        stamp_us = now_us if recorded is None else recorded.stamp_us
        then = "nothing" if recorded is None else self._text(recorded)
        now = "nothing" if computed is None else self._text(LogRecord(now_us, computed))
        built = self._header.entries.get(BUILD, "unknown")
        other = "" if built == build() else f" (recorded by build {built}, this is {build()})"
        return ReplayDifferenceError(
            f"{self._log_path}: first difference at {stamp_us / 1e6:.6f}: recorded {then};"
            f" computed {now}{other}"
        )

    def _text(self, record: LogRecord) -> str:
        """Return identifier, bytes and meaning of a frame."""
        frame = record.frame
        meaning = " ".join(line(self._decoder.decode(record), self._begin_us).split()[2:])
        return f"{frame.can_id:03X}#{frame.data.hex().upper()} ({meaning})"
