"""Keys of the hand's terminal and their commands. Pure."""

from __future__ import annotations

from palpate_host.common.command import Command, Grasp, Recover, Release, Rotate, Stop

TURN_DEG = 10.0
STOP_KEY, SEND_KEYS = " ", "\r\n"
QUESTIONS: dict[str, tuple[str, Command]] = {
    "g": ("grasp", Grasp()),
    "r": ("release", Release()),
    "c": ("recover", Recover()),
    "x": ("turn -10 deg about x", Rotate((-TURN_DEG, 0.0, 0.0))),
    "X": ("turn +10 deg about x", Rotate((TURN_DEG, 0.0, 0.0))),
    "y": ("turn -10 deg about y", Rotate((0.0, -TURN_DEG, 0.0))),
    "Y": ("turn +10 deg about y", Rotate((0.0, TURN_DEG, 0.0))),
    "z": ("turn -10 deg about z", Rotate((0.0, 0.0, -TURN_DEG))),
    "Z": ("turn +10 deg about z", Rotate((0.0, 0.0, TURN_DEG))),
}


class HandKeys:
    """Stop is one key; each command that may move the hand waits for Enter. question: its text, or empty."""

    def __init__(self) -> None:
        self.question = ""
        self._waiting: Command | None = None

    def take(self, keys: str) -> Command | None:
        """Return the command of the keys that arrived together, or None.

        A stop among them comes first. Of several keys at once, as when text is pasted, no other command
        follows.
        """
        waiting, self._waiting, self.question = self._waiting, None, ""
        if STOP_KEY in keys:
            return Stop()
        if len(keys) != 1:
            return None
        if keys in SEND_KEYS:
            return waiting
        if keys in QUESTIONS:
            self.question, self._waiting = QUESTIONS[keys]
        return None
