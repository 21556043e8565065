"""Whether all RS-485 lines go on, as one number for the watchdog. Pure."""

from __future__ import annotations

from collections.abc import Sequence


class CommonRounds:
    """Grows when every line has answered anew: it stands still with the first line that does."""

    def __init__(self, lines: int) -> None:
        self._answers = [0] * lines
        self._rounds = 0

    def count(self, answers: Sequence[int]) -> int:
        """answers: of each line since the start."""
        if all(now > before for now, before in zip(answers, self._answers, strict=True)):
            self._answers = list(answers)
            self._rounds += 1
        return self._rounds
