"""Sequence of turns in the demo: 30 deg and back, in pitch 25, about one axis after the other.

In its place the object needs a friction of 0.49 at 30 deg of pitch, which leaves nothing of the twin's 0.5.

The first turn is [target] of hand.toml; the others are commands to the host. Commands are not on the bus, so
they are also written as JSON lines: replaying the bus log needs them.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np

from palpate_edge.common.config_file import decode_json
from palpate_edge.common.errors import DatasetError, reason_of
from palpate_host.common import rotation
from palpate_host.common.command import Rotate
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import OperatorClient

TURNS_DEG = (
    (30.0, 0.0, 0.0),
    (-30.0, 0.0, 0.0),
    (0.0, 25.0, 0.0),
    (0.0, -25.0, 0.0),
    (0.0, 0.0, 30.0),
    (0.0, 0.0, -30.0),
)
PERIOD_US = 4_000_000
"""Time between turns: 2 s of ramp and 2 s to settle."""
ARRIVED_DEG = 2.0
"""Orientation error, as estimated by the host, below which the next turn may start."""
LONGEST_US = 3 * PERIOD_US
"""Time after which the next turn starts even if the last one has not arrived."""


class SentCommand(msgspec.Struct, frozen=True):
    """A command to the host and the time of the host's last tick before it."""

    after_us: int
    rotate: Rotate


class Programme:
    """Sends each turn when it is due; `update` has to be called often."""

    def __init__(
        self, send_command: Callable[[Rotate], HostStatus | None], command_file: Path, duration_s: float
    ) -> None:
        """Create an empty command file; turns that would not end within `duration_s` are not sent.

        send_command: sends a command to the host and returns the host's last tick.
        """
        self._last_us = 1e6 * duration_s - PERIOD_US
        self._send_command, self._command_file = send_command, command_file
        self._begin_us: int | None = None
        self._sent_us = 0
        self._turn = 0
        command_file.write_bytes(b"")

    def update(self, status: HostStatus | None) -> None:
        """Send the next turn if it is due. Raises CommandError if the host rejects it or does not respond."""
        if status is None:
            return
        if self._begin_us is None:
            if status.mode is Mode.MANIPULATE:
                self._begin_us = self._sent_us = status.time_us
            return
        elapsed_us = status.time_us - self._sent_us
        if elapsed_us < PERIOD_US or status.time_us - self._begin_us >= self._last_us:
            return
        if elapsed_us < LONGEST_US and not _has_arrived(status):
            return
        self._turn += 1
        self._sent_us = status.time_us
        rotate = Rotate(TURNS_DEG[self._turn % len(TURNS_DEG)])
        last_tick = self._send_command(rotate)
        if last_tick is not None:
            with self._command_file.open("ab") as file:
                file.write(msgspec.json.encode(SentCommand(last_tick.time_us, rotate)) + b"\n")


def _has_arrived(status: HostStatus) -> bool:
    if status.R_c is None or status.R_d is None:
        return False
    return rotation.angle_deg(np.array(status.R_d) @ np.array(status.R_c).T) <= ARRIVED_DEG


def socket_commander(control_socket: Path) -> Callable[[Rotate], HostStatus | None]:
    """Return a function that sends commands to a host process over its control socket."""

    def send_command(rotate: Rotate) -> HostStatus | None:
        with OperatorClient(control_socket) as client:
            return client.ask(rotate)

    return send_command


def read_commands(path: Path) -> list[SentCommand]:
    """Read the commands in the order they were sent; none if there is no file.

    Raises DatasetError for a damaged file.
    """
    try:
        lines = path.read_bytes().splitlines() if path.exists() else []
    except OSError as error:
        raise DatasetError(f"{path}: {reason_of(error)}: run the demo again") from None
    return [
        decode_json(
            line, SentCommand, f"{path}, line {number}", guide="run the demo again", error=DatasetError
        )
        for number, line in enumerate(lines, start=1)
    ]
