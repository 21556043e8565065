"""Recordings on request: each in a folder of its own, named by date and time."""

from __future__ import annotations

import logging
import time
from pathlib import Path

from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame
from palpate_edge.daemon.config import RecordConfig
from palpate_edge.datasets.recorder import Recorder, RingLimits

_log = logging.getLogger("palpate.recording")


class RecordingControl:
    """Starts and stops recordings as signals request; logs their begin and end.

    folder: of the present recording, empty when there is none.
    """

    def __init__(self, config: RecordConfig) -> None:
        self.folder = ""
        self._recorder = Recorder(
            Path(config.folder), RingLimits(config.megabytes * 1_000_000, config.seconds)
        )
        self._requested: bool | None = None

    @property
    def frames_left_out(self) -> int:
        """Frames that were not recorded because the disk was too slow, since the start."""
        return self._recorder.left_out

    def offer(self, frame: Frame) -> None:
        """Record the frame if a recording runs; called by the capture thread, never waits."""
        self._recorder.offer(frame)

    def request(self, recording: bool) -> None:
        """Request a recording or its end; safe in a signal handler, `update` carries it out."""
        self._requested = recording

    def update(self) -> None:
        """Carry out the last request; log a recording that has ended, with the reason if it failed."""
        requested, self._requested = self._requested, None
        if requested is False:
            self._recorder.stop()
        elif requested and not self._recorder.is_recording:
            self._start()
        if self.folder and not self._recorder.is_recording:
            failure = self._recorder.failure
            _log.log(logging.ERROR if failure else logging.INFO, f"recording ended. {failure}".rstrip(". "))
            self.folder = ""

    def close(self) -> None:
        """End the recording and wait until its frames are on the disk."""
        self._recorder.close()

    def _start(self) -> None:
        try:
            self.folder = str(self._recorder.start(time.strftime("%Y%m%d-%H%M%S")))
        except CaptureError as error:
            _log.error(str(error))
        else:
            _log.info("recording to %s", self.folder)
