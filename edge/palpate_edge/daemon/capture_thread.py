"""The capture thread: read frames, estimate contacts, hand them to the bus loop."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from palpate_edge.can_bus.back_off import BackOff
from palpate_edge.capture.source import Source
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError, PalpateError
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.frame_estimator import FrameEstimator

Outcome = Contact | CaptureError
"""The contact of a frame, or the reason why no frame comes."""

FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.1, 2.0  # between two attempts to read from a lost camera


class CaptureThread(threading.Thread):
    """Reads a source to its end; `fileno()` polls readable when :meth:`take` has outcomes.

    A lost or stalled camera is read again with back-off. on_frame: called with each frame before it is
    estimated, to record it. on_estimated: called after its contact is in `take`; returns whether to wake the
    bus loop once more.
    """

    def __init__(
        self,
        source: Source,
        estimator: FrameEstimator,
        on_frame: Callable[[Frame], None] = lambda _frame: None,
        on_estimated: Callable[[Frame, Contact], bool] = lambda _frame, _contact: False,
    ) -> None:
        super().__init__(name="capture", daemon=True)
        self.source = source
        self.estimator = estimator
        self._on_frame, self._on_estimated = on_frame, on_estimated
        self._outcomes: deque[Outcome] = deque()
        self._event_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._stop_requested = threading.Event()
        self._failure: Exception | None = None
        self._ended = False

    def fileno(self) -> int:
        """Return the descriptor that polls readable when `take` has outcomes."""
        return self._event_fd

    def run(self) -> None:
        """Read and estimate until the source ends, `close` is called or an error ends the thread."""
        back_off = BackOff(FIRST_PAUSE_S, LONGEST_PAUSE_S)
        try:
            while not self._stop_requested.is_set():
                try:
                    frame = self.source.read()
                except (CameraLostError, CameraStalledError) as error:
                    self._put(error)
                    self._stop_requested.wait(back_off.pause())
                    continue
                if frame is None:
                    break
                back_off.reset()
                self._on_frame(frame)
                contact = self.estimator.estimate(frame)
                self._put(contact)
                if self._on_estimated(frame, contact):
                    os.eventfd_write(self._event_fd, 1)
        except Exception as error:  # noqa: BLE001 - not swallowed: take() raises it in the bus loop
            self._failure = error
        self._ended = True
        os.eventfd_write(self._event_fd, 1)

    def take(self) -> list[Outcome]:
        """Return the outcomes since the last call, oldest first. Raises the error that ended the thread."""
        with suppress(BlockingIOError):  # no event; a failure may still follow the last contacts
            os.eventfd_read(self._event_fd)
        outcomes: list[Outcome] = []
        while self._outcomes:
            outcomes.append(self._outcomes.popleft())
        if not outcomes:
            self._raise_failure()
        return outcomes

    @property
    def finished(self) -> bool:
        """True when the source has ended and every outcome was taken."""
        return self._ended and not self._outcomes and self._failure is None

    def close(self) -> None:
        """Stop the thread, wait for its present frame, close the source."""
        self._stop_requested.set()
        if self.is_alive():
            self.join(timeout=2.0)
        if not self.is_alive():
            self.source.close()
            os.close(self._event_fd)

    def _raise_failure(self) -> None:
        failure = self._failure
        dead = not self._ended and self.ident is not None and not self.is_alive()
        if self._outcomes:  # put since `take` emptied the queue: the next call returns them first
            return
        if isinstance(failure, PalpateError):
            raise failure
        if failure is not None or dead:
            raise RuntimeError("the capture thread died") from failure

    def _put(self, outcome: Outcome) -> None:
        self._outcomes.append(outcome)
        os.eventfd_write(self._event_fd, 1)
        # On a shared core the bus loop then sends the contact before the next frame is estimated.
        os.sched_yield()
