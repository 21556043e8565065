"""Child processes of the demo: started one by one, supervised, and stopped in order.

Each process has its own session, so Ctrl-C reaches only the demo, which then stops the others in order. Each
process also registers for SIGTERM in case the demo itself is killed, so none is left running.
"""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, IntEnum
from functools import partial
from pathlib import Path
from types import TracebackType

from palpate_edge.common.errors import PalpateError

STOP_POLL_S = 0.05
STOP_TIMEOUT_S = 30.0
POLL_S = 0.02
PR_SET_PDEATHSIG = 1  # linux/prctl.h

_libc = ctypes.CDLL(None)


class DemoError(PalpateError):
    """A process of the demo ended early, did not stop, or stopped with an error."""


class Program(Enum):
    """The two commands, each with the module that is run by `python -m`."""

    EDGE = "palpate_edge.cli.main"
    HOST = "palpate_host.cli.main"

    @property
    def command(self) -> str:
        """The command's name in a shell."""
        return self.value.partition(".")[0].replace("_", "-")


class RealTimePriority(IntEnum):
    """SCHED_RR priorities on a shared machine.

    The bus is highest because every process waits for it. The fingertips follow, which have their own boards
    on a real hand, then the host, then the drives, which have time until the next SYNC.
    """

    NONE = 0
    DRIVES = 10
    HOST = 20
    FINGERTIP = 30
    BUS = 40


@dataclass(frozen=True, slots=True)
class Child:
    """One running process. stderr: the file to which its standard error is written."""

    name: str
    process: subprocess.Popen[bytes]
    stderr: Path

    def last_line(self) -> str:
        """Return the last non-empty line of its standard error, or an empty string."""
        lines = self.stderr.read_text(encoding="utf-8", errors="replace").split("\n")
        return next((line.strip() for line in reversed(lines) if line.strip()), "")

    def failure(self, what: str) -> DemoError:
        last_line = self.last_line() or "no output"
        return DemoError(f"{self.name} {what}: {last_line} (full output: {self.stderr})")


class Children:
    """Running processes in the order of their start; leaving the context ends all that still run."""

    def __init__(self, folder: Path) -> None:
        """Create an empty set. folder: for NAME.stderr of each process."""
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
        self,
        name: str,
        program: Program,
        arguments: Sequence[str],
        priority: RealTimePriority = RealTimePriority.NONE,
    ) -> Child:
        """Start `program` with `arguments`, with a real-time priority if one is given and permitted."""
        path = self._folder / f"{name}.stderr"
        with path.open("wb") as stderr:
            process = subprocess.Popen(
                [sys.executable, "-m", program.value, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=stderr,
                start_new_session=True,
                preexec_fn=partial(_before_the_program, priority),  # noqa: PLW1509 - one thread
            )
        child = Child(name, process, path)
        self._running.append(child)
        return child

    def check(self) -> None:
        """Raise DemoError if a process has ended, naming the first one in the order of start."""
        for child in self._running:
            status = child.process.poll()
            if status is not None:
                raise child.failure(f"ended early ({_status_text(status)})")

    def find_cause(self) -> None:
        """Check for 1 s whether a process ends: called after a bus error, to name the process behind it."""
        end_s = time.monotonic() + 1.0
        while time.monotonic() < end_s:
            self.check()
            time.sleep(POLL_S)

    def stop(self, *names: str, meanwhile: Callable[[], object] = lambda: None) -> None:
        """Send SIGTERM to the named processes, then wait for each.

        meanwhile: called every STOP_POLL_S while the command waits.
        Raises DemoError for a process that does not end in time or ends with an error.
        """
        stopping = [child for child in self._running if child.name in names]
        for child in stopping:
            child.process.send_signal(signal.SIGTERM)
        for child in stopping:
            try:
                status = _wait(child.process, meanwhile)
            except subprocess.TimeoutExpired:
                raise child.failure(f"did not stop within {STOP_TIMEOUT_S:.0f} s and was killed") from None
            self._running.remove(child)
            if status != 0:
                raise child.failure(f"stopped with an error ({_status_text(status)})")


def _wait(process: subprocess.Popen[bytes], meanwhile: Callable[[], object]) -> int:
    """Return the exit status; subprocess.TimeoutExpired after STOP_TIMEOUT_S."""
    end_s = time.monotonic() + STOP_TIMEOUT_S
    while True:
        meanwhile()
        try:
            return process.wait(STOP_POLL_S)
        except subprocess.TimeoutExpired:
            if time.monotonic() > end_s:
                raise


def _end(child: Child) -> None:
    """End a process and its own children."""
    child.process.send_signal(signal.SIGTERM)
    try:
        child.process.wait(STOP_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        os.killpg(child.process.pid, signal.SIGKILL)
        child.process.wait()


def _status_text(status: int) -> str:
    return f"signal {-status}" if status < 0 else f"exit status {status}"


def _before_the_program(priority: RealTimePriority) -> None:
    """Set up a child before it runs its program: end with the parent, real-time priority.

    SCHED_RR rather than SCHED_FIFO, so that processes of one priority share a core.
    """
    _libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if priority:
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(priority))
