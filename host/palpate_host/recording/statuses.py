"""Reader of the host's status of every tick from a bus log, status lines, an MCAP file or a folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec

from palpate_edge.common.config_file import json_fault
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.log_statuses import log_statuses
from palpate_host.service.replay import read_hand_log


def read_statuses(
    source: Path, config: HandConfig, hand: HandKinematics, note: Callable[[str], None] = lambda _line: None
) -> Iterator[HostStatus]:
    """Yield the status of each tick.

    A bus log is decoded (log_statuses.py); `.jsonl` (of `run --status`) and `.mcap` (of `record` or `export`)
    contain the statuses; a folder of `record` is read as its `.mcap` files in order. A truncated end is
    omitted. note: called with a line for each part that the log lacks. Raises ConfigError, LogError if
    `source` cannot be read.
    """
    if source.is_dir():
        parts = sorted(source.glob("*.mcap"))
        if not parts:
            raise ConfigError(
                f"{source}: no .mcap file in this folder: give a folder of palpate-host record, or a file"
            )
        for part in parts:
            yield from _read_mcap(part)
    elif source.suffix == ".jsonl":
        yield from _read_lines(source)
    elif source.suffix == ".mcap":
        yield from _read_mcap(source)
    else:
        log = read_hand_log(source, config)
        for lack in log.lacks:
            note(f"{source} lacks {lack}")
        yield from log_statuses(log, config, hand)


def _read_lines(source: Path) -> Iterator[HostStatus]:
    decoder = msgspec.json.Decoder(HostStatus)
    lines = source.read_bytes().splitlines(keepends=True)
    for number, line in enumerate(lines, start=1):
        if number == len(lines) and not line.endswith(b"\n"):
            return
        try:
            yield decoder.decode(line)
        except msgspec.MsgspecError:
            raise _not_a_status(f"{source}, line {number}", line) from None


def _read_mcap(source: Path) -> Iterator[HostStatus]:
    # pyarrow, which decompresses it, comes with the extra `record`
    from palpate_host.recording.mcap_reader import STATUS_TOPIC, messages  # noqa: PLC0415

    decoder = msgspec.json.Decoder(HostStatus)
    for payload in messages(source, STATUS_TOPIC):
        try:
            yield decoder.decode(payload)
        except msgspec.MsgspecError:
            raise _not_a_status(f"{source}, {STATUS_TOPIC}", payload) from None


def _not_a_status(where: str, data: bytes) -> ConfigError:
    fault = json_fault(data, HostStatus)
    return ConfigError(
        f"{where}: not a host status ({fault}): give a file of palpate-host run --status or record"
    )
