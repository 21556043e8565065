"""Feeds a bus log through HostCore on a virtual clock: the same frames in, the same frames out, with no
sleep.

Inputs are the log's frames that are not the host's own, at their stamps; ticks fall where the core asks for
them. A log is bound to its contract: its header carries the hash of each EDS and the node map, both are
checked.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from palpate_edge.errors import ConfigError
from palpate_edge.node.object_dictionary import FINGERTIP_EDS
from palpate_host.bus.candump import LogHeader, LogRecord, read_log, write_log
from palpate_host.drives.cia402 import CIA402_EDS
from palpate_host.hand import Hand
from palpate_host.hand_config import HandConfig
from palpate_host.master import HostCore
from palpate_host.network import HEARTBEAT_ID
from palpate_host.supervisor import Mode

EDS_FILES = {"eds.fingertip": FINGERTIP_EDS, "eds.cia402": CIA402_EDS}
EDS_HASH_DIGITS = 16


@dataclass(frozen=True, slots=True)
class Replay:
    """What the host did with a log. modes: as entered; failure: why it stopped, or empty."""

    header: LogHeader
    records: tuple[LogRecord, ...]
    frames_in: int
    modes: tuple[Mode, ...]
    failure: str


def contract_header(config: HandConfig) -> LogHeader:
    """The header of a log of this hand: a hash of each EDS and who each node is."""
    entries = {key: eds_hash(path) for key, path in EDS_FILES.items()}
    nodes = {joint.drive_node: f"drive:{joint.name}" for joint in config.joints}
    nodes |= {finger.fingertip_node: f"fingertip:{finger.name}" for finger in config.fingers}
    return LogHeader(entries | {f"node.0x{node:02X}": who for node, who in sorted(nodes.items())})


def eds_hash(path: Path) -> str:
    """The first 16 hex digits of the file's SHA-256."""
    return hashlib.sha256(path.read_bytes()).hexdigest()[:EDS_HASH_DIGITS]


def check_contract(log_path: Path, header: LogHeader, config: HandConfig) -> None:
    """ConfigError, naming the key, when the log was made with another EDS or node map."""
    for key, expected in contract_header(config).entries.items():
        found = header.entries.get(key)
        if found == expected:
            continue
        if found is None:
            raise ConfigError(
                f"{log_path}: its header has no {key}, so its EDS and nodes are unknown:"
                " record it with the --header lines that `palpate-host contract` prints"
            )
        way_out = (
            "replay it with the palpate version that made it, or record it anew"
            if key in EDS_FILES
            else "give the hand.toml it was recorded with"
        )
        raise ConfigError(f"{log_path}: was made with {key} {found!r}, here it is {expected!r}: {way_out}")


def replay_to_log(log_path: Path, config: HandConfig, hand: Hand) -> Replay:
    """Replay a log file; LogError when it cannot be read, ConfigError when it belongs to another contract."""
    log = read_log(log_path)
    check_contract(log_path, log.header, config)
    if not log.records:
        raise ConfigError(f"{log_path}: holds no frame: record it anew")
    return replay(log.records, config, hand)


def replay(
    records: Sequence[LogRecord], config: HandConfig, hand: Hand, core: HostCore | None = None
) -> Replay:
    """Run `records` (at least one) through a fresh HostCore, or `core`, from the host's first frame to the
    last frame.

    What came before the host's first heartbeat it did not hear; a log without a host is heard from its
    beginning.
    """
    core = core or HostCore(config, hand)
    wanted = set(core.accept_ids)
    own_id = HEARTBEAT_ID + config.network.host_node
    own = (record.stamp_us for record in records if record.frame.can_id == own_id)
    now_us = next(own, records[0].stamp_us)
    end_us = records[-1].stamp_us
    inputs = [r for r in records if r.frame.can_id in wanted and r.stamp_us >= now_us]
    answers: list[LogRecord] = []
    modes: list[Mode] = []
    taken = 0
    while True:
        upto = taken
        while upto < len(inputs) and inputs[upto].stamp_us <= now_us:
            upto += 1
        output = core.process(now_us, [(record.stamp_us, record.frame) for record in inputs[taken:upto]])
        taken = upto
        answers += [LogRecord(now_us, frame) for frame in output.frames_out]
        if output.status is not None and (not modes or modes[-1] is not output.status.mode):
            modes.append(output.status.mode)
        if output.finished or output.next_due_us > end_us:
            return Replay(contract_header(config), tuple(answers), taken, tuple(modes), output.failure)
        now_us = output.next_due_us


def write_output(path: Path, result: Replay) -> None:
    """The host's answers as a candump log."""
    write_log(path, result.header, result.records)
