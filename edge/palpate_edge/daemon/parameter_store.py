"""Saves of parameters by a thread of their own: a flush to a slow card takes seconds."""

from __future__ import annotations

import os
import threading
from collections import deque
from contextlib import suppress
from queue import SimpleQueue

import msgspec

from palpate_edge.common.errors import ConfigError
from palpate_edge.daemon.parameter_file import ParameterFile
from palpate_edge.node.stored_parameters import StoredParameters

LAST_SAVE_S = 10.0  # for the save in progress when the daemon ends


class SaveResult(msgspec.Struct, frozen=True):
    """The result of a save. failure: the reason; empty when the parameters are on the disk."""

    parameters: StoredParameters
    failure: str

    @property
    def stored(self) -> bool:
        """Return whether the parameters are on the disk."""
        return not self.failure


def save(file: ParameterFile, parameters: StoredParameters) -> SaveResult:
    """Save the parameters and return the result."""
    try:
        file.save(parameters)
    except ConfigError as refusal:
        return SaveResult(parameters, str(refusal))
    return SaveResult(parameters, "")


class ParameterStore:
    """Saves to one parameter file, one after the other; `fileno()` polls readable when `take` has results."""

    def __init__(self, file: ParameterFile) -> None:
        self._file = file
        self._requests: SimpleQueue[StoredParameters | None] = SimpleQueue()
        self._results: deque[SaveResult] = deque()
        self._event_fd = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._thread = threading.Thread(target=self._run, name="parameters", daemon=True)
        self._thread.start()

    def fileno(self) -> int:
        """Return the descriptor that polls readable when `take` has results."""
        return self._event_fd

    def request(self, parameters: StoredParameters) -> None:
        """Save the parameters after those requested before; returns at once."""
        self._requests.put(parameters)

    def take(self) -> list[SaveResult]:
        """Return the results since the last call, in the order of the requests."""
        with suppress(BlockingIOError):  # no event
            os.eventfd_read(self._event_fd)
        results = []
        while self._results:
            results.append(self._results.popleft())
        return results

    def close(self) -> None:
        """Wait for the requested saves, at most LAST_SAVE_S."""
        self._requests.put(None)
        self._thread.join(LAST_SAVE_S)
        if not self._thread.is_alive():
            os.close(self._event_fd)

    def _run(self) -> None:
        while (parameters := self._requests.get()) is not None:
            self._results.append(save(self._file, parameters))
            os.eventfd_write(self._event_fd, 1)
