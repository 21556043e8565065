"""A hand as a Python object: commands over the control socket, and a host process when none runs yet."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from palpate_edge.common.errors import PalpateError
from palpate_host.common.command import (
    Command,
    CommandError,
    Grasp,
    Move,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.common.mode import MOVING, STOPPED, Mode
from palpate_host.common.status import HostStatus
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import Status
from palpate_host.operator.server import default_control_socket

POLL_S = 0.02
START_TIMEOUT_S = 30.0
STOP_TIMEOUT_S = 10.0
GAIT_ENDS = ("", "refused", "stopped", "done")
"""The values of the status hold.gait when a turn by finger gaiting is over."""
ACCEPTING = (Mode.READY, *MOVING, *STOPPED)


class HandStoppedError(CommandError):
    """The hand entered FAULT or STOP during a call that waited for something else; the text is its reason."""


class Hand:
    """A hand that a host controls; make it with `open`. Each call blocks until the hand is done, or raises.

    CommandError: the present mode does not allow the command; the text states what to do first.
    HandStoppedError: the hand stopped meanwhile. NoHostError: the host has ended.
    """

    def __init__(self, path: Path) -> None:
        """Connect to a running host; `path`: its control socket."""
        self._path = path
        self._client = OperatorClient(path)
        self._process: _HostProcess | None = None

    @classmethod
    def open(
        cls, config: str | Path, socket: str | Path | None = None, timeout_s: float = START_TIMEOUT_S
    ) -> Hand:
        """Connect to the host on `socket`, or start one from `config` when there is none.

        socket: `default_control_socket()` when None. A host that was started here ends with `close`. Returns
        once the hand accepts commands, also in FAULT or STOP: then call `recover`. Raises PalpateError with
        the last line of the started host's log when it ends, CommandError when the hand is not ready within
        `timeout_s`.
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
            hand.wait_for(lambda s: s.mode in ACCEPTING, timeout_s, "accept commands", stops=False)
        except BaseException:
            hand.close()
            raise
        return hand

    def grasp(self, timeout_s: float = 10.0) -> HostStatus:
        """Close until every finger is in contact; CommandError when one is not within `timeout_s`."""
        self._send(Grasp())
        return self.wait_for(
            lambda s: s.mode is Mode.GRASP and all(finger.in_contact for finger in s.fingers),
            timeout_s,
            "touch the object with every finger",
        )

    def rotate(
        self, rpy_deg: tuple[float, float, float], ramp_s: float | None = None, timeout_s: float = 60.0
    ) -> HostStatus:
        """Turn the object by roll, pitch, yaw about the hand's fixed axes, from its last desired orientation.

        ramp_s: the duration, None for target.ramp_s of hand.toml. Returns when the ramp ends; the error that
        is left is `orientation_error_deg` of the status.
        """
        roll, pitch, yaw = (float(angle) for angle in rpy_deg)
        self._send(Rotate((roll, pitch, yaw), ramp_s))
        return self.wait_for(
            lambda s: s.target_rpy_deg == (roll, pitch, yaw) and (s.turned or 0.0) >= 1.0,
            timeout_s,
            "turn the object",
        )

    def move(
        self,
        xyz_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rpy_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
        ramp_s: float | None = None,
        timeout_s: float = 60.0,
    ) -> HostStatus:
        """Move and turn the object along and about the hand's fixed axes, from its last desired pose.

        Only under control.law = "pose". ramp_s: the duration, None for target.ramp_s of hand.toml. Returns
        when the ramp ends. CommandError when the target is beyond the hand's workspace.
        """
        x, y, z = (float(length) for length in xyz_mm)
        roll, pitch, yaw = (float(angle) for angle in rpy_deg)
        self._send(Move((x, y, z), (roll, pitch, yaw), ramp_s))
        sent_us = self.status().time_us  # of a tick that may be earlier than the command
        return self.wait_for(lambda s: s.time_us > sent_us and (s.turned or 0.0) >= 1.0, timeout_s, "move")

    def reorient(
        self,
        rpy_deg: tuple[float, float, float],
        corners_mm: Sequence[tuple[float, float, float]],
        timeout_s: float = 180.0,
    ) -> HostStatus:
        """Turn the object by any angle about the hand's fixed axes; fingers lift in turn and take hold again.

        Only under control.law = "pose", with four fingers and more. corners_mm: of the convex object, in the
        hand's frame, where it is now. Returns when the turn is done. CommandError, with the reason, when it
        cannot be planned or is stopped on the way; the hand then goes on holding.
        """
        roll, pitch, yaw = (float(angle) for angle in rpy_deg)
        corners = tuple((float(x), float(y), float(z)) for x, y, z in corners_mm)
        self._send(Reorient((roll, pitch, yaw), corners))
        sent_us = self.status().time_us  # of a tick that may be earlier than the command
        status = self.wait_for(
            lambda s: s.time_us > sent_us and s.hold is not None and s.hold.gait in GAIT_ENDS,
            timeout_s,
            "turn the object",
        )
        assert status.hold is not None
        if status.hold.gait != "done":
            raise CommandError(status.hold.gait_reason or "the turn ended: the object is held no more")
        return status

    def release(self, timeout_s: float = 10.0) -> HostStatus:
        """Open the hand and return to READY, with torque 0."""
        self._send(Release())
        return self.wait_for(lambda s: s.mode is Mode.READY, timeout_s, "open")

    def stop(self, timeout_s: float = 5.0) -> HostStatus:
        """Stop the hand: quick stop, then drives off."""
        self._send(Stop())
        return self.wait_for(lambda s: s.mode in STOPPED, timeout_s, "stop", stops=False)

    def recover(self, timeout_s: float = START_TIMEOUT_S) -> HostStatus:
        """Lead the hand out of FAULT or STOP to READY; nothing moves until `grasp`. Waits for drives off."""
        end_s = time.monotonic() + timeout_s
        while True:
            try:
                self._send(Recover())
                break
            except CommandError as exc:
                if "still stopping" not in str(exc) or time.monotonic() > end_s:
                    raise
            time.sleep(POLL_S)
        return self.wait_for(lambda s: s.mode is Mode.READY, timeout_s, "be ready")

    def status(self) -> HostStatus:
        """Return the status of the last tick."""
        status = self._client.ask(Status())
        if status is None:
            raise CommandError("the host has not ticked yet: ask again")
        return status

    def stream(self) -> Iterator[HostStatus]:
        """Yield the status of every tick from now on, over a connection of its own.

        Ticks are skipped while the reader is slower than the host.
        """
        with OperatorClient(self._path) as client:
            yield from client.stream()

    def wait_for(
        self, condition: Callable[[HostStatus], bool], timeout_s: float, what: str, stops: bool = True
    ) -> HostStatus:
        """Return the first status that meets `condition`.

        what: completes "the hand did not ..." in the CommandError that is raised after `timeout_s`. Raises
        HandStoppedError, unless `stops` is False, when the hand stops meanwhile.
        """
        end_s = time.monotonic() + timeout_s
        while not condition(status := self.status()):
            if stops and status.mode in STOPPED:
                raise HandStoppedError(
                    f"{status.mode.value}: {status.reason}: remove the cause, then recover()"
                )
            if time.monotonic() > end_s:
                raise CommandError(
                    f"the hand did not {what} within {timeout_s:g} s ({status.mode.value}: {status.reason})"
                )
            time.sleep(POLL_S)
        return status

    def close(self) -> None:
        """Disconnect; a host process started by `open` stops the hand and ends."""
        self._client.close()
        if self._process is not None:
            self._process.end()
            self._process = None

    def __enter__(self) -> Hand:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _send(self, command: Command) -> None:
        self._client.ask(command)


class _HostProcess:
    """A child process ``palpate-host run --start command``."""

    def __init__(self, config: Path, path: Path | None) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-")
        self._path = path or Path(self._folder.name) / "host.sock"
        self._log = (Path(self._folder.name) / "host.stderr").open("w+b")
        arguments = ["run", "--config", str(config), "--start", "command", "--socket", str(self._path)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "palpate_host.cli.main", *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._log,
            start_new_session=True,  # Ctrl-C reaches the caller, who closes the hand in order
        )

    def wait_for_socket(self, timeout_s: float) -> Path:
        """Return the control socket once the host accepts connections.

        The file alone does not count: a killed host leaves its socket behind. Raises PalpateError with the
        last line of the host's log when it ends or does not listen within `timeout_s`.
        """
        end_s = time.monotonic() + timeout_s
        while True:
            with contextlib.suppress(NoHostError):
                OperatorClient(self._path).close()
                return self._path
            if self._process.poll() is not None or time.monotonic() > end_s:
                raise PalpateError(f"the host did not start: {self._last_line()}")
            time.sleep(POLL_S)

    def _last_line(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1].removeprefix("error: ") if lines else "its log is empty"

    def end(self) -> None:
        """Send SIGTERM, on which the host stops the hand; SIGKILL when it does not end within 10 s."""
        self._process.terminate()
        try:
            self._process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._log.close()
        self._folder.cleanup()
