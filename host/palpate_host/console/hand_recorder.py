"""A recording of the hand that the console's page starts and stops: `palpate-host record` in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from palpate_edge.common.errors import MissingExtraError, PalpateError
from palpate_host.common.command import CommandError
from palpate_host.config.hand_config import HandConfig
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.protocol import Status
from palpate_host.recording.bounds import Bounds
from palpate_host.service.host import hand_of

LONGEST_START_S = 20.0


class HandRecorder:
    """Writes one recording at a time to a folder of its own.

    name: of the recording that is being written, or empty. failure: why the last one ended early, or empty.
    """

    def __init__(
        self, folder: Path, config: HandConfig, socket_path: Path, changed: Callable[[], None]
    ) -> None:
        """changed: called when `name` or `failure` has changed."""
        self.name = self.failure = ""
        self._folder, self._config, self._socket, self._changed = folder, config, socket_path, changed
        self._lock, self._ended, self._begun = threading.Lock(), threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None

    def start(self) -> str:
        """Start a recording and return its name. Raises PalpateError: NoHostError or CommandError when this
        user may not use the control socket, ConfigError or BusError when it cannot begin."""
        with OperatorClient(self._socket) as client:
            client.ask(Status())
        with self._lock:
            if self.name:
                raise CommandError(f"{self.name} is being recorded already: stop it first")
            name = time.strftime("%Y%m%d-%H%M%S")
            self._ended.clear()
            self._begun.clear()
            self.failure = ""
            self._thread = threading.Thread(target=self._run, args=(name,), name="record", daemon=True)
            self._thread.start()
            if not self._begun.wait(LONGEST_START_S) or self.failure:
                self._ended.set()
                raise CommandError(self.failure or "the recording did not begin: see the bus")
            return name

    def stop(self) -> str:
        """End the recording and return its name. Raises CommandError when there is none."""
        with self._lock:
            if not self.name or self._thread is None:
                raise CommandError("nothing is being recorded")
            name = self.name
            self._ended.set()
            self._thread.join()
            return name

    def close(self) -> None:
        """End a recording that is being written."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, name: str) -> None:
        def begun() -> None:
            self.name = name
            self._begun.set()
            self._changed()

        try:
            self._record(self._folder / name, begun)
        except PalpateError as error:
            self.failure = str(error)
        finally:
            self.name = ""
            self._begun.set()
            self._changed()

    def _record(self, folder: Path, begun: Callable[[], None]) -> None:
        # needs the extra `record`, which slow imports come with
        try:
            from palpate_host.recording.hand_recording import record_hand  # noqa: PLC0415
        except ModuleNotFoundError as error:
            raise MissingExtraError("record", str(error.name), "record") from None
        hand = hand_of(self._config)
        record_hand(folder, self._config, hand, Bounds(), self._socket, self._ended.is_set, begun)
