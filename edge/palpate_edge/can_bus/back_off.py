"""Exponential back-off: growing pauses between attempts."""

from __future__ import annotations

from typing import Generic, TypeVar

Time = TypeVar("Time", int, float)


class BackOff(Generic[Time]):
    """Pauses that double from `first` up to `longest`, in the unit of both."""

    def __init__(self, first: Time, longest: Time) -> None:
        self._first: Time = first
        self._longest: Time = longest
        self._next: Time = first

    def pause(self) -> Time:
        """Return the pause before the next attempt; the pause after it is twice as long."""
        pause = self._next
        self._next = min(pause + pause, self._longest)
        return pause

    def reset(self) -> None:
        """Begin again with the first pause: an attempt has succeeded."""
        self._next = self._first
