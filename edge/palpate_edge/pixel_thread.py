"""The one thread for the pixels: capture and estimate, and hand each contact to the bus loop."""

from __future__ import annotations

import os
import threading
from collections import deque
from contextlib import suppress
from typing import Protocol

from palpate_edge.capture.frame import Frame
from palpate_edge.contact_type import Contact
from palpate_edge.errors import PalpateError
from palpate_edge.estimator import Estimator


class Source(Protocol):
    """A capture source that waits for its next frame."""

    dropped: int

    def read(self) -> Frame | None:
        """The next frame, None when there will be no more. Raises CaptureError."""
        ...

    def close(self) -> None: ...


class PixelThread(threading.Thread):
    """Reads a source to its end; `fileno()` polls readable when :meth:`take` has something to give."""

    def __init__(self, source: Source, estimator: Estimator) -> None:
        super().__init__(name="pixels", daemon=True)
        self.source = source
        self.estimator = estimator
        self._contacts: deque[Contact] = deque()
        self._wake = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._asked_to_stop = threading.Event()
        self._failure: Exception | None = None
        self._finished = False

    def fileno(self) -> int:
        return self._wake

    def run(self) -> None:
        try:
            while not self._asked_to_stop.is_set():
                frame = self.source.read()
                if frame is None:
                    break
                self._contacts.append(self.estimator.estimate(frame))
                os.eventfd_write(self._wake, 1)
        except Exception as error:  # noqa: BLE001 - not swallowed: take() raises it in the bus loop
            self._failure = error
        self._finished = True
        os.eventfd_write(self._wake, 1)

    def take(self) -> list[Contact]:
        """The contacts since the last call, oldest first. Raises what stopped the thread, if anything did."""
        with suppress(BlockingIOError):  # nothing new; a failure may still wait behind the last contacts
            os.eventfd_read(self._wake)
        failure = self._failure  # read first: contacts appended later belong to the next call
        contacts = []
        while self._contacts:
            contacts.append(self._contacts.popleft())
        if failure is not None and not contacts:
            if isinstance(failure, PalpateError):
                raise failure
            raise RuntimeError("the pixel thread died") from failure
        return contacts

    @property
    def finished(self) -> bool:
        """The source has ended and every contact was taken."""
        return self._finished and not self._contacts and self._failure is None

    def close(self) -> None:
        """Ask the thread to end, wait for its frame in work, and release what it holds."""
        self._asked_to_stop.set()
        if self.is_alive():
            self.join(timeout=2.0)
        if not self.is_alive():
            self.source.close()
            os.close(self._wake)
