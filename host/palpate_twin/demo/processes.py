"""The processes of the demo: started one by one, watched, stopped in order, never left behind.

Each process has a session of its own, so that Ctrl-C reaches the demo alone and the demo stops them in order,
and asks the kernel for SIGTERM should the demo itself be killed.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import partial
from pathlib import Path
from types import TracebackType

from palpate_edge.common.errors import PalpateError

STOP_TIMEOUT_S = 30.0
POLL_S = 0.02
PR_SET_PDEATHSIG = 1  # linux/prctl.h

_libc = ctypes.CDLL(None)


class DemoError(PalpateError):
    """A process of the demo ended early, would not stop, or stopped with an error."""


class Program(Enum):
    """Which command a process runs, by the module behind it."""

    EDGE = "palpate_edge.cli.main"
    HOST = "palpate_host.cli.main"

    @property
    def command(self) -> str:
        """The name it has in a shell."""
        return self.value.removesuffix(".cli").replace("_", "-")


class Urgency(IntEnum):
    """Who goes ahead where all share a machine, as a priority of SCHED_RR: the bus, as all wait for it; the
    fingertips, boards of their own elsewhere; the host; last the drives, which have until the next SYNC."""

    NONE = 0
    DRIVES = 10
    HOST = 20
    FINGERTIP = 30
    BUS = 40


@dataclass(frozen=True, slots=True)
class Child:
    """One running process. stderr: the file that takes what it says."""

    name: str
    process: subprocess.Popen[bytes]
    stderr: Path

    def last_words(self) -> str:
        """The last line it wrote to stderr; empty when it said nothing."""
        lines = self.stderr.read_text(encoding="utf-8", errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def failure(self, what: str) -> DemoError:
        said = self.last_words() or "it said nothing"
        return DemoError(f"{self.name} {what}: {said} (all it said: {self.stderr})")


class Children:
    """The running processes in the order of their start; leaving the context ends every one that is left."""

    def __init__(self, folder: Path) -> None:
        """`folder` takes one NAME.stderr a process."""
        self._folder = folder
        self._running: list[Child] = []

    def __enter__(self) -> Children:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for child in reversed(self._running):
            _end(child)
        self._running.clear()

    def start(
        self, name: str, program: Program, arguments: Sequence[str], urgency: Urgency = Urgency.NONE
    ) -> Child:
        """Start `program` with `arguments`, in the real-time class where it has an urgency and may."""
        path = self._folder / f"{name}.stderr"
        with path.open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-m", program.value, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                start_new_session=True,
                preexec_fn=partial(_before_the_program, urgency),  # noqa: PLW1509 - one thread
            )
        child = Child(name, process, path)
        self._running.append(child)
        return child

    def check(self) -> None:
        """Raises DemoError, naming the first in the order of start, when a process has ended."""
        for child in self._running:
            status = child.process.poll()
            if status is not None:
                raise child.failure(f"ended early ({_status_text(status)})")

    def blame(self) -> None:
        """As `check`, for use when the bus fails: gives the process that is behind it a moment to end."""
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            self.check()
            time.sleep(POLL_S)

    def stop(self, *names: str) -> None:
        """SIGTERM to the named processes at once, then wait for each.

        Raises DemoError for one that does not end in time or ends with an error.
        """
        leaving = [child for child in self._running if child.name in names]
        for child in leaving:
            child.process.send_signal(signal.SIGTERM)
        for child in leaving:
            try:
                status = child.process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                raise child.failure(f"did not stop within {STOP_TIMEOUT_S:.0f} s and was killed") from None
            self._running.remove(child)
            if status != 0:
                raise child.failure(f"stopped with an error ({_status_text(status)})")


def _end(child: Child) -> None:
    """End a process and all that it may have started."""
    child.process.send_signal(signal.SIGTERM)
    try:
        child.process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(child.process.pid, signal.SIGKILL)
        child.process.wait()


def _status_text(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"


def _before_the_program(urgency: Urgency) -> None:
    """End with the parent; urgent ones of a kind take turns, as several share a core here."""
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if urgency:
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(urgency))
