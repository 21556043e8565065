"""Plays a recording on the hand's page, at its own pace."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from palpate_edge.common.errors import ConfigError, PalpateError
from palpate_edge.web.broadcast import Broadcast
from palpate_host.common.command import CommandError
from palpate_host.common.status import HostStatus
from palpate_host.config.hand_config import HandConfig
from palpate_host.console.hand_news import HandNews
from palpate_host.console.hand_scene import SceneMaker
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import hand_of

PERIOD_S = 0.1
LONGEST_PAUSE_S = 1.0
"""A longer gap in a recording is shortened to this."""


class RecordingPlayer:
    """Publishes the statuses of one recording at a time.

    name: of the recording that is played, or empty. failure: why the last one ended early, or empty.
    """

    def __init__(self, config: HandConfig, broadcast: Broadcast, changed: Callable[[], None]) -> None:
        """changed: called when `name` or `failure` has changed."""
        self.name = self.failure = ""
        self._config, self._broadcast, self._changed = config, broadcast, changed
        self._lock, self._ended = threading.Lock(), threading.Event()
        self._thread: threading.Thread | None = None

    def start(self, source: Path) -> None:
        """Play a recording from its beginning, instead of the one that is played."""
        with self._lock:
            self.close()
            self._ended.clear()
            self.name, self.failure = source.name, ""
            self._thread = threading.Thread(target=self._run, args=(source,), name="play", daemon=True)
            self._thread.start()
        self._changed()

    def stop(self) -> None:
        """End playing. Raises CommandError when nothing is played."""
        with self._lock:
            if not self.name:
                raise CommandError("nothing is being played")
            self.close()

    def close(self) -> None:
        """End a recording that is played."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self, source: Path) -> None:
        try:
            self._play(source)
        except PalpateError as error:
            self.failure = str(error)
        finally:
            self._broadcast.forget("hand")
            self.name = ""
            self._changed()

    def _play(self, source: Path) -> None:
        scenes, hand = SceneMaker(self._config), hand_of(self._config)
        begun_us = shown_us = None
        due_s = time.monotonic()
        for status in read_statuses(source, self._config, hand):
            if self._ended.is_set():
                return
            if begun_us is None or shown_us is None:
                self._check(source, status)
                begun_us = status.time_us
            else:
                step_s = (status.time_us - shown_us) / 1e6
                if step_s < PERIOD_S:
                    continue
                due_s += min(step_s, LONGEST_PAUSE_S)
            if self._ended.wait(max(0.0, due_s - time.monotonic())):
                return
            shown_us = status.time_us
            at_s = (shown_us - begun_us) / 1e6
            self._broadcast.publish("hand", HandNews(status, scenes.of(status), source.name, at_s))

    def _check(self, source: Path, status: HostStatus) -> None:
        """Raise ConfigError for the recording of another hand."""
        config = self._config
        for what, recorded, own in (
            ("joints", status.joints, config.joints),
            ("fingers", status.fingers, config.fingers),
        ):
            names, expected = [one.name for one in recorded], [one.name for one in own]
            if names != expected:
                raise ConfigError(
                    f"{source.name} has the {what} {', '.join(names)}, this hand {', '.join(expected)}: "
                    "start the console with the hand.toml of that recording"
                )
