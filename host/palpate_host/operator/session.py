"""A running hand in Python: commands over the control socket, and a host process where none runs."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from palpate_edge.common.errors import PalpateError
from palpate_host.common.command import Command, CommandError, Grasp, Recover, Release, Rotate, Stop
from palpate_host.common.mode import MOVING, STOPPED, Mode
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import Status
from palpate_host.operator.server import default_control_socket

POLL_S = 0.02
START_TIMEOUT_S = 30.0
STOP_TIMEOUT_S = 10.0
ANSWERING = (Mode.READY, *MOVING, *STOPPED)


class HandStoppedError(CommandError):
    """The hand went to fault or stop while something was waited for; the text is its reason."""


class Hand:
    """A hand that a host runs; make it with `open`. Calls block until the hand has done it, or raise.

    CommandError: the hand refuses in its present mode, and says what to do first. HandStoppedError: it
    stopped meanwhile. NoHostError: the host is gone.
    """

    def __init__(self, path: Path) -> None:
        """path: the control socket of a running host."""
        self._path = path
        self._client = OperatorClient(path)
        self._process: _HostProcess | None = None

    @classmethod
    def open(
        cls, config: str | Path, socket: str | Path | None = None, timeout_s: float = START_TIMEOUT_S
    ) -> Hand:
        """The hand that the host on `socket` (default: the usual one) runs, or else one that a host process
        started here runs from `config`, which ends with `close`.

        Returns once it takes commands, or is in fault or stop: then `recover`. Raises what the started host
        says when it ends, CommandError when it is not ready within `timeout_s`.
        """
        path = Path(socket) if socket is not None else default_control_socket()
        try:
            hand = cls(path)
        except NoHostError:
            process = _HostProcess(Path(config), None if socket is None else path)
            try:
                hand = cls(process.wait_for_socket(timeout_s))
            except BaseException:
                process.end()
                raise
            hand._process = process
        try:
            hand.wait_for(lambda s: s.mode in ANSWERING, timeout_s, "take commands", stops=False)
        except BaseException:
            hand.close()
            raise
        return hand

    def grasp(self, timeout_s: float = 10.0) -> HostStatus:
        """Close until every finger touches; CommandError when one does not within `timeout_s`."""
        self._tell(Grasp())
        return self.wait_for(
            lambda s: s.mode is Mode.GRASP and all(finger.in_contact for finger in s.fingers),
            timeout_s,
            "touch with every finger",
        )

    def rotate(
        self, rpy_deg: tuple[float, float, float], ramp_s: float | None = None, timeout_s: float = 60.0
    ) -> HostStatus:
        """Turn the object by roll, pitch, yaw about the hand's fixed axes, from where it was to be before.

        ramp_s: in what time; None: target.ramp_s of hand.toml. Returns when the whole turn is asked for; what
        is missing then is `orientation_error_deg` of the status.
        """
        roll, pitch, yaw = (float(angle) for angle in rpy_deg)
        self._tell(Rotate((roll, pitch, yaw), ramp_s))
        return self.wait_for(
            lambda s: s.target_rpy_deg == (roll, pitch, yaw) and s.turned >= 1.0, timeout_s, "turn the object"
        )

    def release(self, timeout_s: float = 10.0) -> HostStatus:
        """Open and let the joints go."""
        self._tell(Release())
        return self.wait_for(lambda s: s.mode is Mode.READY, timeout_s, "open")

    def stop(self, timeout_s: float = 5.0) -> HostStatus:
        """Quick stop, drives off."""
        self._tell(Stop())
        return self.wait_for(lambda s: s.mode in STOPPED, timeout_s, "stop", stops=False)

    def recover(self, timeout_s: float = START_TIMEOUT_S) -> HostStatus:
        """Out of fault or stop, to READY: nothing moves until `grasp`. Waits until the drives are off."""
        end_s = time.monotonic() + timeout_s
        while True:
            try:
                self._tell(Recover())
                break
            except CommandError as exc:
                if "still stopping" not in str(exc) or time.monotonic() > end_s:
                    raise
            time.sleep(POLL_S)
        return self.wait_for(lambda s: s.mode is Mode.READY, timeout_s, "be ready")

    def status(self) -> HostStatus:
        """Of the last tick."""
        status = self._client.ask(Status())
        if status is None:
            raise CommandError("the host has not ticked yet: ask again")
        return status

    def stream(self) -> Iterator[HostStatus]:
        """The status of every tick from now on, over a connection of its own; ticks are left out while the
        reader is slower than the host."""
        with OperatorClient(self._path) as client:
            yield from client.stream()

    def wait_for(
        self, condition: Callable[[HostStatus], bool], timeout_s: float, what: str, stops: bool = True
    ) -> HostStatus:
        """The first status that meets `condition`.

        CommandError when none does within `timeout_s`; HandStoppedError, unless `stops` is False, when the
        hand stops meanwhile.
        """
        end_s = time.monotonic() + timeout_s
        while not condition(status := self.status()):
            if stops and status.mode in STOPPED:
                raise HandStoppedError(f"{status.mode.value}: {status.reason}: see to it, then recover()")
            if time.monotonic() > end_s:
                raise CommandError(
                    f"the hand did not {what} within {timeout_s:g} s ({status.mode.value}: {status.reason})"
                )
            time.sleep(POLL_S)
        return status

    def close(self) -> None:
        """Leave the hand; a host process started by `open` stops the hand and ends."""
        self._client.close()
        if self._process is not None:
            self._process.end()
            self._process = None

    def __enter__(self) -> Hand:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _tell(self, command: Command) -> None:
        self._client.ask(command)


class _HostProcess:
    """`palpate-host run --start command` as a process of ours."""

    def __init__(self, config: Path, path: Path | None) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-")
        self._path = path or Path(self._folder.name) / "host.sock"
        self._words = (Path(self._folder.name) / "host.stderr").open("w+b")
        arguments = ["run", "--config", str(config), "--start", "command", "--socket", str(self._path)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "palpate_host.cli.main", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._words,
            start_new_session=True,  # Ctrl-C reaches the caller, who closes the hand in order
        )

    def wait_for_socket(self, timeout_s: float) -> Path:
        """PalpateError with what the host said last when it ends or does not listen in time.

        A socket that a killed host left behind lies there from the beginning, so only an answer counts.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            with contextlib.suppress(NoHostError):
                OperatorClient(self._path).close()
                return self._path
            if self._process.poll() is not None or time.monotonic() > end_s:
                raise PalpateError(f"the host did not start: {self._last_words()}")
            time.sleep(POLL_S)

    def _last_words(self) -> str:
        self._words.seek(0)
        lines = self._words.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "it said nothing"

    def end(self) -> None:
        """SIGTERM, by which it stops the hand; SIGKILL when it does not end in time."""
        self._process.terminate()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._words.close()
        self._folder.cleanup()
