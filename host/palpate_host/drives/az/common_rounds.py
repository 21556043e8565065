"""The progress of all RS-485 lines as one number for the watchdog. Pure."""

from __future__ import annotations

from collections.abc import Sequence


class CommonRounds:
    """A count that grows when every line has responded again, and stalls when one line does not."""

    def __init__(self, lines: int) -> None:
        self._responses = [0] * lines
        self._rounds = 0

    def count(self, responses: Sequence[int]) -> int:
        """Return the count. responses: number received on each line since the start."""
        if all(now > before for now, before in zip(responses, self._responses, strict=True)):
            self._responses = list(responses)
            self._rounds += 1
        return self._rounds
