"""One boot of a machine: takes a list of tests and returns an outcome for each."""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import msgspec

POLL_S = 0.05
END_S = 20.0  # from the last test's outcome to the machine's end
CONSOLE_LINES = 60  # shown when a machine ends too early
HANG_S = 120  # a test that takes longer leaves its stack on the console

PASSED_ON = (
    "PALPATE_NO_SKIP",
    "PALPATE_CANOPEND",
    "PALPATE_CANOPEN_DEMO",
    "TZ",
)  # environment variables that are passed to the tests inside


class Outcome(msgspec.Struct, frozen=True):
    """Result of one test. outcome: pytest's ``passed``, ``failed`` or ``skipped``; text: reason."""

    test: str
    outcome: str
    text: str = ""


@dataclass(frozen=True)
class Inside:
    """Files visible in a machine: the project, the shared folder, the Python of the tests."""

    project: Path
    folder: Path
    python: Path
    environment: dict[str, str] = field(default_factory=dict)


class Machine(Protocol):
    """A kind of kernel: `user_mode` and `virtual_machine` make one each."""

    name: str
    limit_s: float

    def missing(self) -> str | None:
        """Return what is not installed and how to install it; None where this machine can run."""

    def inside(self, project: Path, folder: Path) -> Inside:
        """Build the missing files of a boot; report their paths."""

    def command(self, folder: Path) -> list[str]:
        """Boot, run ``folder/run.sh``, and end."""


class Run:
    """A booted machine that runs `tests` (node ids) with these options of pytest."""

    def __init__(
        self, machine: Machine, project: Path, tests: Sequence[str], options: Sequence[str] = ()
    ) -> None:
        self._machine = machine
        self._tests = len(tests)
        self._folder = tempfile.TemporaryDirectory(prefix=f"palpate-{machine.name}-")
        self.folder = Path(self._folder.name)
        self._outcomes: dict[str, Outcome] = {}
        self._read_to = 0
        (self.folder / "tests").write_text("".join(f"{test}\n" for test in tests))
        (self.folder / "run.sh").write_text(_script(machine.inside(project, self.folder), options))
        with (self.folder / "console.log").open("wb") as console:
            # Both machines end cleanly on SIGTERM: `timeout` forwards it after the limit or on request, or
            # (`setpriv`) when pytest was killed before it could ask.
            guard = ["setpriv", "--pdeathsig", "TERM", "timeout", "--kill-after=10"]
            self._process = subprocess.Popen(
                [*guard, f"{machine.limit_s:.0f}", *machine.command(self.folder)],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
            )

    def outcome(self, test: str) -> Outcome:
        """Wait for the end of `test`. A machine that ends earlier gives a failure with its last lines."""
        while True:
            ended = self._process.poll() is not None
            self._read_outcomes()
            if test in self._outcomes:
                return self._outcomes[test]
            if ended:
                return Outcome(test, "failed", self._last_words())
            time.sleep(POLL_S)

    def close(self) -> None:
        """End the machine; at once if tests still run in it."""
        if len(self._outcomes) == self._tests:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(END_S)
        self._process.terminate()
        self._process.wait()
        self._folder.cleanup()

    def _read_outcomes(self) -> None:
        path = self.folder / "outcomes.jsonl"
        if not path.exists():
            return
        with path.open("rb") as lines:
            lines.seek(self._read_to)
            for line in lines:
                if not line.endswith(b"\n"):
                    return
                self._read_to += len(line)
                outcome = msgspec.json.decode(line, type=Outcome)
                self._outcomes[outcome.test] = outcome

    def _last_words(self) -> str:
        lines = (self.folder / "console.log").read_text(errors="replace").splitlines()
        return "\n".join(
            [
                f"{self._machine.name} ended before this test did, or was ended after "
                f"{self._machine.limit_s:.0f} s; its console:",
                *lines[-CONSOLE_LINES:],
            ]
        )


def _script(inside: Inside, options: Sequence[str]) -> str:
    environment = {
        **inside.environment,
        **{name: os.environ[name] for name in PASSED_ON if name in os.environ},
        "PALPATE_OUTCOMES": str(inside.folder / "outcomes.jsonl"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    pytest = [
        f"{inside.python}",
        *(
            "-m",
            "pytest",
            "-q",
            "--color=no",
            "-p",
            "no:cacheprovider",
            "-o",
            f"faulthandler_timeout={HANG_S}",
        ),
        *options,
        f"@{inside.folder}/tests",
    ]
    return "".join(
        [
            *(f"export {name}={shlex.quote(value)}\n" for name, value in environment.items()),
            f"cd {shlex.quote(str(inside.project))}\n",
            f"{shlex.join(pytest)}\n",
        ]
    )
