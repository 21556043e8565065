"""What the demo asks of the hand: turns by 30 deg and back, about one axis after the other.

The first one is hand.toml's [target]; the others are commands to the host. They are kept as JSON
lines, for modes and targets come from a replay of the bus log, where they are not.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.errors import DatasetError
from palpate_host.common import rotation
from palpate_host.common.command import Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient

TURNS_DEG = (
    (30.0, 0.0, 0.0),
    (-30.0, 0.0, 0.0),
    (0.0, 30.0, 0.0),
    (0.0, -30.0, 0.0),
    (0.0, 0.0, 30.0),
    (0.0, 0.0, -30.0),
)
PERIOD_US = 4_000_000
"""From turn to turn: 2 s of ramp, and as long to settle."""
ARRIVED_DEG = 2.0
"""As the host feels it; a hand that a slow machine slows down gets the time it needs for that."""
LONGEST_US = 3 * PERIOD_US


class Given(msgspec.Struct, frozen=True):
    """A command and the host's last tick before it."""

    after_us: int
    rotate: Rotate


class Programme:
    """Gives the turns, each when its time has come; `look` is to be called often."""

    def __init__(self, ask: Callable[[Rotate], HostStatus | None], given: Path, duration_s: float) -> None:
        """ask: gives the host a command, returns its last tick. given: the file that takes what was asked
        for. A turn that would not be over is left out."""
        self._last_us = 1e6 * duration_s - PERIOD_US
        self._ask, self._given = ask, given
        self._begin_us: int | None = None
        self._asked_us = 0
        self._turn = 0
        given.write_bytes(b"")

    def look(self, status: HostStatus | None) -> None:
        """Raises CommandError when the host refuses or is gone."""
        if status is None:
            return
        if self._begin_us is None:
            if status.mode is Mode.MANIPULATE:
                self._begin_us = self._asked_us = status.time_us
            return
        taken_us = status.time_us - self._asked_us
        if taken_us < PERIOD_US or status.time_us - self._begin_us >= self._last_us:
            return
        if taken_us < LONGEST_US and not _has_arrived(status):
            return
        self._turn += 1
        self._asked_us = status.time_us
        rotate = Rotate(TURNS_DEG[self._turn % len(TURNS_DEG)])
        answer = self._ask(rotate)
        if answer is not None:
            with self._given.open("ab") as file:
                file.write(msgspec.json.encode(Given(answer.time_us, rotate)) + b"\n")


def _has_arrived(status: HostStatus) -> bool:
    if status.R_c is None or status.R_d is None:
        return False
    return rotation.angle_deg(np.array(status.R_d) @ np.array(status.R_c).T) <= ARRIVED_DEG


def ask_by_socket(control_socket: Path) -> Callable[[Rotate], HostStatus | None]:
    """Commands for the host's process."""

    def ask(rotate: Rotate) -> HostStatus | None:
        with OperatorClient(control_socket) as client:
            return client.ask(rotate)

    return ask


def read_given(path: Path) -> list[Given]:
    """What was asked for, in order; nothing where there is no file. Raises DatasetError for a damaged one."""
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
        return [msgspec.json.decode(line, type=Given) for line in lines]
    except (OSError, msgspec.DecodeError) as error:
        raise DatasetError(f"{path} cannot be read ({error}): run the demo again") from None
