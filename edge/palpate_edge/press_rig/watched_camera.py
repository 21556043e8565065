"""The camera of a run that is also watched: a thread reads every frame, and the run takes the next one."""

from __future__ import annotations

import threading
from collections.abc import Callable

from palpate_edge.capture.source import Source
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.frame import Frame

RETRY_S = 0.2


class WatchedCamera:
    """Reads `source` until it is closed. show: takes each frame, in the thread."""

    def __init__(self, source: Source, show: Callable[[Frame], None]) -> None:
        self._source, self._show = source, show
        self._changed = threading.Condition()
        self._newest: Frame | CaptureError | None = None
        self._has_ended, self._is_closed = False, threading.Event()
        self._thread = threading.Thread(target=self._run, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> Frame | None:
        """Wait for a frame that `read` has not returned; None when there will be no more.

        Raises CaptureError as the source.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._has_ended)
            newest, self._newest = self._newest, None
        if isinstance(newest, CaptureError):
            raise newest
        return newest

    def close(self) -> None:
        """End the thread; the source stays open."""
        self._is_closed.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._is_closed.is_set() and self._read_one():
                pass
        finally:  # whatever ended the thread, a run must not wait with the ball on the dome
            with self._changed:
                self._has_ended = True
                self._changed.notify()

    def _read_one(self) -> bool:
        """Read and show a frame; return whether there may be another one."""
        try:
            frame = self._source.read()
        except CaptureError as error:
            self._keep(error)
            self._is_closed.wait(RETRY_S)
            return True
        if frame is None:
            return False
        self._keep(frame)
        self._show(frame)
        return True

    def _keep(self, newest: Frame | CaptureError) -> None:
        with self._changed:
            self._newest = newest
            self._changed.notify()
