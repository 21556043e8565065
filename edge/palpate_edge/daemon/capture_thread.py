"""The one thread for the pixels: capture and estimate, and hand each contact to the bus loop."""

from __future__ import annotations

import os
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

from palpate_edge.capture.source import Source
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CameraLostError, CameraStalledError, CaptureError, PalpateError
from palpate_edge.common.frame import Frame
from palpate_edge.estimation.estimator import Estimator

Outcome = Contact | CaptureError
"""What a frame gave, or why there is none for now."""

FIRST_RETRY_S, LONGEST_RETRY_S = 0.1, 2.0  # between two attempts to open a camera again


class CaptureThread(threading.Thread):
    """Reads a source to its end; `fileno()` polls readable when :meth:`take` has something to give.

    A camera that is lost or stalls is read again, with back-off. on_frame: sees each frame first, as a
    recorder does.
    """

    def __init__(
        self, source: Source, estimator: Estimator, on_frame: Callable[[Frame], None] = lambda _frame: None
    ) -> None:
        super().__init__(name="pixels", daemon=True)
        self.source = source
        self.estimator = estimator
        self._on_frame = on_frame
        self._outcomes: deque[Outcome] = deque()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._asked_to_stop = threading.Event()
        self._failure: Exception | None = None
        self._finished = False

    def fileno(self) -> int:
        return self._wake

    def run(self) -> None:
        retry_s = FIRST_RETRY_S
        try:
            while not self._asked_to_stop.is_set():
                try:
                    frame = self.source.read()
                except (CameraLostError, CameraStalledError) as error:
                    self._give(error)
                    self._asked_to_stop.wait(retry_s)
                    retry_s = min(2 * retry_s, LONGEST_RETRY_S)
                    continue
                if frame is None:
                    break
                retry_s = FIRST_RETRY_S
                self._on_frame(frame)
                self._give(self.estimator.estimate(frame))
        except Exception as error:  # noqa: BLE001 - not swallowed: take() raises it in the bus loop
            self._failure = error
        self._finished = True
        os.eventfd_write(self._wake, 1)

    def take(self) -> list[Outcome]:
        """What came since the last call, oldest first. Raises what stopped the thread, if anything did."""
        with suppress(BlockingIOError):  # nothing new; a failure may still wait behind the last contacts
            os.eventfd_read(self._wake)
        outcomes: list[Outcome] = []
        while self._outcomes:
            outcomes.append(self._outcomes.popleft())
        if not outcomes:
            self._raise_what_ended_it()
        return outcomes

    @property
    def finished(self) -> bool:
        """The source has ended and every outcome was taken."""
        return self._finished and not self._outcomes and self._failure is None

    def close(self) -> None:
        """Ask the thread to end, wait for its frame in work, and release what it holds."""
        self._asked_to_stop.set()
        if self.is_alive():
            self.join(timeout=2.0)
        if not self.is_alive():
            self.source.close()
            os.close(self._wake)

    def _raise_what_ended_it(self) -> None:
        failure = self._failure
        dead = not self._finished and self.ident is not None and not self.is_alive()
        if self._outcomes:  # given since they were looked for: first those, at the next call
            return
        if isinstance(failure, PalpateError):
            raise failure
        if failure is not None or dead:
            raise RuntimeError("the pixel thread died") from failure

    def _give(self, outcome: Outcome) -> None:
        self._outcomes.append(outcome)
        os.eventfd_write(self._wake, 1)
        os.sched_yield()  # on a core that both share the bus loop sends before the next frame is begun
