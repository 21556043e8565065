"""A recording of any length: a folder of numbered pieces, each a bus log and an MCAP file.

A piece has a largest size; beyond the folder's largest size the oldest pieces are deleted. Everything is
flushed to the disk once a second, so a power cut costs at most that second: a candump log is read line by
line, an unfinished MCAP file chunk by chunk (mcap_reader.py).
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType

from palpate_bus.logs.candump import LogRecord, LogWriter
from palpate_edge.common.atomic_write import make_folder
from palpate_edge.common.errors import ConfigError
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.bounds import Bounds
from palpate_host.recording.mcap import McapRecording
from palpate_host.service.contract import recording_header
from palpate_host.service.host_records import HostRecorder

FLUSH_EVERY_US = 1_000_000


class SegmentedRecording:
    """Writer of the pieces 000001, 000002, ... in a folder; use it as a context manager."""

    def __init__(self, folder: Path, config: HandConfig, hand: HandKinematics, bounds: Bounds) -> None:
        """Create the folder. Raises ConfigError if that fails, or if the folder has a recording already."""
        self._folder, self._config, self._hand, self._bounds = folder, config, hand, bounds
        self.frames = self.ticks = self.pieces = 0
        self._log: LogWriter | None = None
        self._mcap: McapRecording | None = None
        self._flushed_us: int | None = None
        self._recorder = HostRecorder(config)
        make_folder(folder, ConfigError)
        if any(folder.glob("*.mcap")):
            raise ConfigError(f"{folder}: already contains a recording: give another folder or remove it")
        self._begin()

    def __enter__(self) -> SegmentedRecording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, now_us: int, records: Iterable[LogRecord], statuses: Iterable[HostStatus]) -> None:
        """Write the frames and statuses up to `now_us`. Raises ConfigError, LogError if the disk fails."""
        assert self._log is not None and self._mcap is not None
        for record in records:
            self._log.write(record)
            self.frames += 1
        for status in statuses:
            for note in self._recorder.notes(status):
                self._log.note(note)
            self._mcap.write(status)
            self.ticks += 1
        self._log.flush()  # whole lines, so that a killed process leaves no truncated one
        if self._flushed_us is None or now_us - self._flushed_us >= FLUSH_EVERY_US:
            self._flushed_us = now_us
            self._to_disk()
            if _size(self._paths(self.pieces)) >= self._bounds.piece_bytes:
                self.close()
                self._begin()
            self._delete_oldest()

    def close(self) -> None:
        """End the piece; a second call has no effect."""
        if self._mcap is not None:
            self._mcap.close()
        if self._log is not None:
            self._log.close()
        self._mcap = self._log = None

    def _begin(self) -> None:
        self.pieces += 1
        log, mcap = self._paths(self.pieces)
        self._log = LogWriter(log, recording_header(self._config))
        self._recorder = HostRecorder(self._config)
        self._mcap = McapRecording(mcap, self._hand, [finger.name for finger in self._config.fingers])

    def _paths(self, piece: int) -> tuple[Path, Path]:
        return self._folder / f"{piece:06}.log", self._folder / f"{piece:06}.mcap"

    def _to_disk(self) -> None:
        assert self._log is not None and self._mcap is not None
        self._mcap.flush()
        for path in self._paths(self.pieces):
            with path.open("rb") as file:
                os.fsync(file.fileno())

    def _delete_oldest(self) -> None:
        """Delete the oldest pieces while the folder is too large; the present piece stays."""
        sizes = {log: _size((log, log.with_suffix(".mcap"))) for log in sorted(self._folder.glob("*.log"))}
        total = sum(sizes.values())
        for log in list(sizes)[:-1]:
            if total <= self._bounds.folder_bytes:
                return
            total -= sizes[log]
            log.unlink(missing_ok=True)
            log.with_suffix(".mcap").unlink(missing_ok=True)


def _size(paths: Iterable[Path]) -> int:
    return sum(path.stat().st_size for path in paths if path.exists())
