"""Recordings that a person asks for by signal: each in a folder of its own, named by the time of day."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.config import RecordConfig
from palpate_edge.datasets.recorder import Recorder, RingLimits


class RecordingControl:
    """report: gets what a person should know.

    folder: of the recording that runs, empty when there is none.
    """

    def __init__(self, config: RecordConfig, report: Callable[[str], None]) -> None:
        self.folder = ""
        self._recorder = Recorder(
            Path(config.folder), RingLimits(config.megabytes * 1_000_000, config.seconds)
        )
        self._report = report
        self._wanted: bool | None = None

    def offer(self, frame: Frame) -> None:
        """From the pixel thread."""
        self._recorder.offer(frame)

    def request(self, wanted: bool) -> None:
        """From a signal handler: `update` does it."""
        self._wanted = wanted

    def update(self) -> None:
        """Start or stop as asked; tell when a recording has ended by itself."""
        wanted, self._wanted = self._wanted, None
        if wanted is False:
            self._recorder.stop()
        elif wanted and not self._recorder.is_recording:
            self._start()
        if self.folder and not self._recorder.is_recording:
            self._report(f"recording ended. {self._recorder.failure}".rstrip(". "))
            self.folder = ""

    def close(self) -> None:
        self._recorder.close()

    def _start(self) -> None:
        try:
            self.folder = str(self._recorder.start(time.strftime("%Y%m%d-%H%M%S")))
        except CaptureError as error:
            self._report(str(error))
        else:
            self._report(f"recording to {self.folder}")
