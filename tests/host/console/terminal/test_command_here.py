"""The view of a hand in the terminal of this process, beside a control socket with a given status."""

from __future__ import annotations

import threading
from contextlib import closing, contextmanager

import pytest
from tests.terminal_here import terminal_here

from palpate_host.common.command import CommandError, Grasp, Stop
from palpate_host.common.mode import Mode
from palpate_host.common.status import Counters, HostStatus
from palpate_host.console.terminal import command_hand
from palpate_host.console.terminal.command_hand import command_in_terminal
from palpate_host.operator.server import OperatorSocket

READY = HostStatus(
    *(1, Mode.READY, "", "", (), (), None, None, None, None),
    *(None, None, None, "", Counters(), None, (), None, None),
)


@contextmanager
def host_on(path, execute):
    """A control socket that is served ten times a tick."""
    ended = threading.Event()

    def serve():
        while not ended.wait(0.002):
            socket.serve(execute, READY)

    with closing(OperatorSocket(path)) as socket:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


@pytest.mark.long
def test_a_hand_is_shown_commanded_and_lost(tmp_path, monkeypatch):
    monkeypatch.setattr(command_hand, "RETRY_S", 0.05)
    commands = []

    def execute(command):
        commands.append(command)
        if isinstance(command, Grasp):
            raise CommandError("grasp is refused: not now")

    path = tmp_path / "host.sock"
    with terminal_here(100, 24) as terminal:
        terminal.start(lambda: command_in_terminal(path, threading.Event()))
        terminal.until(lambda screen: screen.rows[0].startswith("no hand is running"), "no host")
        with host_on(path, execute):
            terminal.until(lambda screen: screen.rows[0].startswith("ready"), "not ready")
            terminal.press("g")
            terminal.until(lambda screen: screen.rows[23].startswith("grasp: Enter"), "no question")
            assert commands == []
            terminal.press("\r")
            terminal.until(
                lambda screen: screen.rows[22].startswith("grasp refused: grasp is refused: not now"), "sent"
            )
            terminal.press(" ")
            terminal.until(lambda screen: screen.rows[22].startswith("stop: accepted"), "no stop")
        terminal.until(lambda screen: not screen.rows[0].startswith("ready"), "the loss is not shown")
        terminal.press("q")
        terminal.finish()
    assert commands == [Grasp(), Stop()]


@pytest.mark.long
def test_an_answer_is_shown_for_a_while_and_the_stop_event_ends_the_view(tmp_path, monkeypatch):
    monkeypatch.setattr(command_hand, "NOTICE_S", 1.5)
    stopped = threading.Event()
    with terminal_here(100, 24) as terminal:
        terminal.start(lambda: command_in_terminal(tmp_path / "none.sock", stopped))
        terminal.press(" ")
        terminal.until(lambda screen: screen.rows[22].startswith("stop refused: no hand"), "no refusal")
        terminal.until(lambda screen: not screen.rows[22].strip(), "the notice stays")
        stopped.set()
        terminal.finish()
