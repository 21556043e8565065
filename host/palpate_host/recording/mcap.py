"""The host's status as an MCAP file with the topics of topics.py.

A file that was never closed (killed process, power cut) is readable record by record without its index;
`flush` ends a chunk, and everything before it is in the file.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, cast

import foxglove

from palpate_host.common.status import HostStatus
from palpate_host.control.kinematics import HandKinematics
from palpate_host.recording.mcap_file import McapFile
from palpate_host.recording.topics import HandTopics


class McapRecording:
    """Writer of one MCAP file; close it, or use it as a context manager."""

    def __init__(self, path: Path, hand: HandKinematics, fingers: Iterable[str]) -> None:
        """Open the file and declare the channels. Raises ConfigError when it cannot be written."""
        context = foxglove.Context()
        self._file = McapFile(path)
        self._writer = foxglove.open_mcap(cast(BinaryIO, self._file), context=context)
        self._topics = HandTopics(context, hand, fingers)

    def __enter__(self) -> McapRecording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the file. Raises ConfigError when anything could not be written."""
        self._writer.close()
        self._file.close()
        self._file.check()

    def flush(self) -> None:
        """End the chunk: what was written so far is readable even if the file is never closed.

        Raises ConfigError when anything could not be written.
        """
        self._writer.flush()
        self._file.flush()
        self._file.check()

    def attach(self, name: str, media_type: str, data: bytes, time_us: int) -> None:
        """Attach a file that belongs to the recording, such as its bus log."""
        time_ns = 1000 * time_us
        self._writer.attach(
            log_time=time_ns, create_time=time_ns, name=name, media_type=media_type, data=data
        )

    def write(self, status: HostStatus) -> None:
        """Write one tick. A contact is written once, when its sequence number is new."""
        self._topics.write(status)
