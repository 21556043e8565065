"""The newest event of each kind, for any number of listeners; a slow listener skips events."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec

Event = tuple[str, bytes]
"""Kind and JSON of an event."""


class Listener:
    """One reader of a broadcast; `next` returns what it has not returned before."""

    def __init__(self, newest: Callable[[int, float], tuple[int, list[Event]]]) -> None:
        self._newest = newest
        self._seen = 0

    def next(self, timeout_s: float) -> list[Event]:
        """Wait for events; return the newest of each kind, oldest first, none after `timeout_s`."""
        self._seen, events = self._newest(self._seen, timeout_s)
        return events


class Broadcast:
    """Keeps the newest event of each kind; `publish` and `listen` may be called by any thread.

    listeners: how many are connected. on_listeners: called when the first comes and the last leaves.
    """

    def __init__(self) -> None:
        self.listeners = 0
        self.on_listeners: Callable[[bool], None] = lambda _any: None
        self._changed = threading.Condition()
        self._events: dict[str, tuple[int, bytes]] = {}
        self._count = 0

    def publish(self, kind: str, value: Any) -> None:
        """Replace the newest event of this kind. value: what msgspec can encode as JSON."""
        data = msgspec.json.encode(value)
        with self._changed:
            self._count += 1
            self._events[kind] = (self._count, data)
            self._changed.notify_all()

    def forget(self, kind: str) -> None:
        """Do not show the newest event of this kind to later listeners."""
        with self._changed:
            self._events.pop(kind, None)

    @contextmanager
    def listen(self) -> Iterator[Listener]:
        """Yield a listener, which begins with the newest event of each kind."""
        self._changes_by(1)
        try:
            yield Listener(self._newer)
        finally:
            self._changes_by(-1)

    def _changes_by(self, step: int) -> None:
        with self._changed:
            before, self.listeners = self.listeners, self.listeners + step
            if (before == 0) != (self.listeners == 0):
                self.on_listeners(self.listeners > 0)

    def _newer(self, seen: int, timeout_s: float) -> tuple[int, list[Event]]:
        with self._changed:
            self._changed.wait_for(lambda: self._count > seen, timeout_s)
            newer = sorted((at, kind, data) for kind, (at, data) in self._events.items() if at > seen)
            return self._count, [(kind, data) for _, kind, data in newer]
