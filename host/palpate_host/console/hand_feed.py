"""The feed of a hand's page: the host's status at most ten times a second, and commands for the host.

Both go through the host's control socket, with the permissions of the console's user there.
"""

from __future__ import annotations

import threading
from pathlib import Path

import msgspec

from palpate_edge.common.config_file import json_fault
from palpate_edge.web.broadcast import Broadcast
from palpate_host.common.command import (
    Command,
    CommandError,
    Grasp,
    Recover,
    Release,
    Reorient,
    Rotate,
    Stop,
)
from palpate_host.console.hand_news import HandNews
from palpate_host.console.hand_scene import SceneMaker
from palpate_host.console.recordings import RecordingCommand, Recordings
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.protocol import Status

PERIOD_S = 0.1
ALONE_S = 1.0
"""Without a page the host is asked this often, so that the next page begins with a recent status."""
RETRY_S = 0.5
ANSWER_S = 0.8
"""A host that does not answer for so long hangs; the page shows it within a second."""
_commands = msgspec.json.Decoder(Grasp | Rotate | Reorient | Release | Stop | Recover | RecordingCommand)


class HandState(msgspec.Struct, frozen=True):
    """The connection to the host. text: how the hand is seen, or why not and what to do."""

    connected: bool
    text: str


class HandFeed:
    """Publishes the status of the host behind a control socket, and connects again when the host has
    ended. While a recording is played, the player publishes in place of it."""

    def __init__(
        self, socket_path: Path, scenes: SceneMaker, broadcast: Broadcast, recordings: Recordings
    ) -> None:
        self._path, self._scenes, self._broadcast = socket_path, scenes, broadcast
        self._recordings = recordings
        self._stopped, self._wake = threading.Event(), threading.Event()
        broadcast.on_listeners = lambda _any: self._wake.set()
        self._thread = threading.Thread(target=self._run, name="feed", daemon=True)
        self._thread.start()

    def run(self, body: bytes) -> str:
        """Carry out a page's command, a JSON object: one of the control socket, or one of recordings.py.

        Raises PalpateError to refuse it: CommandError with the host's reason, NoHostError when none runs.
        """
        try:
            command: Command | RecordingCommand = _commands.decode(body)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            fault = json_fault(body, Command | RecordingCommand)
            raise CommandError(f"not a command ({fault}): see docs/using.md") from None
        if isinstance(command, RecordingCommand):
            return self._recordings.run(command)
        if self._recordings.is_playing and not isinstance(command, Stop):
            raise CommandError("the page shows a recording, not the hand: stop playing first")
        with OperatorClient(self._path) as client:
            client.ask(command)
        return f"{type(command).__name__.lower()}: accepted"

    def close(self) -> None:
        """Disconnect."""
        self._stopped.set()
        self._wake.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stopped.is_set():
            try:
                with OperatorClient(self._path, timeout_s=ANSWER_S) as client:
                    self._follow(client)
            except CommandError as error:
                self._broadcast.publish("state", HandState(False, str(error)))
                self._stopped.wait(RETRY_S)

    def _follow(self, client: OperatorClient) -> None:
        """Publish statuses until the host ends. Raises CommandError."""
        is_shown = False
        while not self._stopped.is_set():
            status = client.ask(Status())
            if not is_shown:
                self._broadcast.publish("state", HandState(True, "live, from the host"))
                is_shown = True
            if status is not None and not self._recordings.is_playing:
                self._broadcast.publish("hand", HandNews(status, self._scenes.of(status)))
            self._wake.wait(PERIOD_S if self._broadcast.listeners else ALONE_S)
            self._wake.clear()
