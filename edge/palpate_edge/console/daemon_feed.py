"""The feed of a running daemon: its watch socket, and the ring of frames that it writes meanwhile."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import msgspec

from palpate_edge.capture.frame_ring import RingFrame, RingReader
from palpate_edge.common.errors import CaptureError
from palpate_edge.common.local_sockets.unix_socket import peer_of
from palpate_edge.console.events import ConsoleState, health_of_daemon
from palpate_edge.console.feed import NewestPicture
from palpate_edge.console.pictures import LooseBeads, console_frame
from palpate_edge.daemon.watching.watch_messages import (
    LONGEST_PACKET,
    WatchAnswer,
    WatchCommand,
    WatchedFingertip,
    WatchedFrame,
    WatchedHealth,
    WatchMessage,
    WatchRefusedError,
    WatchRequest,
)
from palpate_edge.daemon.watching.watch_socket import decode_message
from palpate_edge.web.broadcast import Broadcast

SILENT_S = 2.5
"""A daemon that sends no health for so long hangs."""
RETRY_S = 0.5
ANSWER_S = 3.0
WAKE_S = 0.2


def connect_daemon(paths: list[Path]) -> socket.socket | None:
    """Return a connection to the daemon of one of these sockets; None when none runs, or not for this
    user."""
    for path in paths:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        connection.settimeout(WAKE_S)
        with suppress(OSError):
            connection.connect(str(path))
            if os.geteuid() == 0 or peer_of(connection).uid in (0, os.geteuid()):
                return connection
        connection.close()
    return None


class DaemonFeed:
    """Publishes what a daemon sends, and connects again when the daemon has ended.

    Pictures are requested while the broadcast has listeners. timeout_ms: capture.timeout_ms.
    widest_px: of the published pictures.
    """

    def __init__(
        self,
        name: str,
        timeout_ms: int,
        open_connection: Callable[[], socket.socket | None],
        broadcast: Broadcast,
        picture: NewestPicture,
        widest_px: int,
    ) -> None:
        self._name, self._timeout_ms, self._open = name, timeout_ms, open_connection
        self._broadcast, self._picture, self._widest_px = broadcast, picture, widest_px
        self._connection: socket.socket | None = None
        self._ring: _RingView | None = None
        self._loose: LooseBeads | None = None
        self._sending = threading.Lock()
        self._answered = threading.Condition()
        self._answers: dict[int, WatchAnswer] = {}
        self._number = 0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
        broadcast.on_listeners = self._want_pictures
        self._thread.start()

    def execute(self, command: WatchCommand, level: int) -> str:
        """Have the daemon carry out a command. Raises WatchRefusedError with the daemon's reason."""
        number = self._send(command, level)
        with self._answered:
            if not self._answered.wait_for(lambda: number in self._answers, ANSWER_S):
                raise WatchRefusedError(f"the daemon of {self._name} does not answer: see its log")
            answer = self._answers.pop(number)
        if answer.refused:
            raise WatchRefusedError(answer.refused)
        return answer.text

    def guide(self, _action: str, _number: float | None) -> str:
        """Refuse: the daemon estimates with its calibration, and has the camera."""
        raise WatchRefusedError(
            f"the daemon of {self._name} has the camera: end it and this console, then start palpate-edge "
            "watch again to calibrate"
        )

    def close(self) -> None:
        """Disconnect."""
        self._stopped.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stopped.is_set():
            connection = self._open()
            if connection is None:
                self._say(False, f"no daemon of {self._name} runs: palpate-edge run --config FILE starts one")
                self._stopped.wait(RETRY_S)
                continue
            self._connection = connection
            self._forget(connection, self._follow(connection))

    def _follow(self, connection: socket.socket) -> str:
        """Publish messages until the daemon ends; return the text that states why none follow."""
        with suppress(WatchRefusedError):
            self._want_pictures(self._broadcast.listeners > 0)
        heard_s, is_silent = time.monotonic(), False
        ended = f"the daemon of {self._name} has ended: see its log; this page reconnects"
        self._say(True, "live, from the daemon")
        while not self._stopped.is_set():
            try:
                packet = connection.recv(LONGEST_PACKET)
            except TimeoutError:
                if time.monotonic() - heard_s > SILENT_S and not is_silent:
                    is_silent = True
                    self._say(False, f"the daemon of {self._name} does not answer: see its log")
                continue
            except OSError:
                return ended
            if not packet:
                return ended
            message = decode_message(packet)
            if message is None:
                return "the daemon is of another version: restart it and this console"
            if is_silent:
                self._say(True, "live, from the daemon")
            heard_s, is_silent = time.monotonic(), False
            self._handle(message)
        return ended

    def _handle(self, message: WatchMessage) -> None:
        match message:
            case WatchedFingertip():
                self._ring = _RingView(Path(message.pictures))
                self._loose = LooseBeads() if message.method == "none" else None
                self._broadcast.publish("fingertip", message)
            case WatchedHealth():
                health = health_of_daemon(message.report, self._timeout_ms)
                self._broadcast.publish("health", health)
            case WatchedFrame():
                self._show(message)
            case WatchAnswer():
                with self._answered:
                    self._answers[message.number] = message
                    self._answered.notify_all()

    def _show(self, message: WatchedFrame) -> None:
        picture = None if self._ring is None else self._ring.of(message.contact.sequence)
        if picture is None or not self._broadcast.listeners:
            return
        beads = message.beads if self._loose is None else self._loose.find(picture.image)
        self._picture.show(picture.image, picture.sequence)
        frame = console_frame(picture.image, message.contact, message.latency_ms, beads, self._widest_px)
        self._broadcast.publish("frame", frame)

    def _forget(self, connection: socket.socket, why: str) -> None:
        self._connection = None
        connection.close()
        if self._ring is not None:
            self._ring.close()
        if not self._stopped.is_set():
            self._say(False, why)
            self._stopped.wait(RETRY_S)

    def _want_pictures(self, wanted: bool) -> None:
        """Request pictures, or none; without a daemon the next connection does."""
        with suppress(WatchRefusedError):
            self._send("pictures" if wanted else "no_pictures", 0)

    def _send(self, command: WatchCommand, level: int) -> int:
        """Send a request; return its number. Raises WatchRefusedError when no daemon runs."""
        with self._sending:
            self._number += 1
            packet = msgspec.json.encode(WatchRequest(self._number, command, level))
            connection = self._connection
            try:
                if connection is None:
                    raise BrokenPipeError
                connection.send(packet, socket.MSG_NOSIGNAL)
            except OSError:
                raise WatchRefusedError(f"no daemon of {self._name} runs: start it first") from None
            return self._number

    def _say(self, connected: bool, text: str) -> None:
        self._broadcast.publish("state", ConsoleState(connected, text))


class _RingView:
    """The daemon's ring of frames, opened again when the daemon has made another."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._reader: RingReader | None = None
        self._inode = 0
        self._newest: RingFrame | None = None

    def of(self, sequence: int) -> RingFrame | None:
        """Return the picture of a frame; None when it was overwritten or the ring has gone."""
        try:
            inode = self._path.stat().st_ino
            if self._reader is None or inode != self._inode:
                self.close()
                self._reader, self._inode = RingReader(self._path, newest_unread=True), inode
            newest = self._reader.newest()
        except (FileNotFoundError, CaptureError):
            self.close()
            return None
        self._newest = newest or self._newest
        picture = self._newest
        return picture if picture is not None and picture.sequence == sequence else None

    def close(self) -> None:
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()
