"""Show and command a hand in the terminal until it is stopped."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from palpate_edge.common.terminal.screen import QUIT, alternate_screen
from palpate_host.common.command import Command, CommandError
from palpate_host.common.status import HostStatus
from palpate_host.console.terminal.hand_keys import HandKeys
from palpate_host.console.terminal.hand_lines import hand_lines
from palpate_host.operator.client import OperatorClient
from palpate_host.operator.protocol import Status

PERIOD_S = 0.1
RETRY_S = 0.5
ANSWER_S = 0.8
"""A host that does not answer for so long hangs."""
NOTICE_S = 6.0
"""The answer to a command is shown for so long."""


class NewestStatus:
    """The host's newest status. connection: why none comes, or empty."""

    def __init__(self) -> None:
        self.status: HostStatus | None = None
        self.connection = "connecting"


def command_in_terminal(socket_path: Path, stopped: threading.Event) -> None:
    """Show the hand on standard output until `stopped`, or until q is pressed; the hand goes on.

    Status and commands go through the host's control socket, with this user's permissions there. Raises
    ConfigError when this is no terminal.
    """
    keys, notice, noticed_s = HandKeys(), "", 0.0
    with alternate_screen() as screen, _polling(socket_path) as newest:
        while not stopped.is_set():
            pressed = screen.keys(PERIOD_S)
            command = keys.take(pressed) if pressed else None
            if command is not None:
                notice, noticed_s = _sent(socket_path, command), time.monotonic()
            elif QUIT in pressed:
                return
            if time.monotonic() - noticed_s > NOTICE_S:
                notice = ""
            screen.draw(partial(hand_lines, newest.status, newest.connection, notice, keys.question))


def _sent(socket_path: Path, command: Command) -> str:
    """Send a command; return what the host answers."""
    name = type(command).__name__.lower()
    try:
        with OperatorClient(socket_path) as client:
            client.ask(command)
    except CommandError as error:
        return f"{name} refused: {error}"
    return f"{name}: accepted"


@contextmanager
def _polling(socket_path: Path) -> Iterator[NewestStatus]:
    """Yield the newest status, polled ten times a second in a thread, which connects again after a loss."""
    newest, ended = NewestStatus(), threading.Event()

    def follow(client: OperatorClient) -> None:
        while not ended.is_set():
            newest.status = client.ask(Status())
            newest.connection = ""
            ended.wait(PERIOD_S)

    def run() -> None:
        while not ended.is_set():
            try:
                with OperatorClient(socket_path, timeout_s=ANSWER_S) as client:
                    follow(client)
            except CommandError as error:
                newest.status, newest.connection = None, str(error)
                ended.wait(RETRY_S)

    thread = threading.Thread(target=run, name="status", daemon=True)
    thread.start()
    try:
        yield newest
    finally:
        ended.set()
        thread.join(ANSWER_S)
