"""The journal of a host's inputs: all that a replay needs to repeat a tick."""

from __future__ import annotations

from collections.abc import Collection

from palpate_host.common.tick_inputs import HostEvent, HostInput, TickInputs
from palpate_host.service.host_records import counted_ids


class InputJournal:
    """Counts the frames that are taken, and keeps the events between them, from tick to tick."""

    def __init__(self, accept_ids: Collection[int]) -> None:
        """accept_ids: the CAN identifiers that the host receives."""
        self._counted = counted_ids(accept_ids)
        self._taken = self._until_us = self._event_count = 0
        self._events: list[HostInput] = []

    def note_frame(self, stamp_us: int, can_id: int) -> None:
        """Count a received frame."""
        self._taken += can_id in self._counted
        self._until_us = max(self._until_us, stamp_us)

    def note(self, event: HostEvent) -> None:
        """Keep an event with its place among the frames."""
        self._events.append(HostInput(self._taken, event))
        self._event_count += 1

    def take(self, now_us: int, *, waits: bool) -> TickInputs:
        """Return what came since the last tick.

        now_us: the time of this call; waits: whether the hand waits for commands.
        """
        inputs = TickInputs(
            called_us=now_us,
            taken=self._taken,
            until_us=self._until_us,
            events=tuple(self._events),
            event_count=self._event_count,
            waits=waits,
        )
        self._taken, self._events = 0, []
        return inputs
