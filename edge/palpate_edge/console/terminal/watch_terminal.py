"""Show a fingertip in the terminal until it is stopped."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from pathlib import Path

import msgspec

from palpate_edge.common.errors import PalpateError
from palpate_edge.common.terminal.notices import notices_for_later
from palpate_edge.common.terminal.screen import QUIT, alternate_screen
from palpate_edge.console.feed import NewestPicture, PageCommand, PageCommands
from palpate_edge.console.open_feed import open_feed
from palpate_edge.console.terminal.fingertip_lines import fingertip_lines
from palpate_edge.console.terminal.fingertip_view import FingertipView
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.web.broadcast import Broadcast

KEY_S, EVENT_S = 0.05, 0.2
"""Longest waits of a round: for a key, for an event."""
COMMAND_KEYS = {"s": "snapshot", "t": "tare", "b": "identify"}
WIDEST_PX = 320
"""Pictures of this width are enough for a terminal of 300 columns, and take a quarter of the time."""
NOTICE_S = 6.0
"""The answer to a command is shown for so long."""


def watch_in_terminal(config: FingertipConfig, stopped: threading.Event) -> None:
    """Show the fingertip on standard output until `stopped`, or until q is pressed.

    A running daemon is watched; without one this process takes the camera. Raises ConfigError when this is
    no terminal, and what `CameraFeed` raises.
    """
    broadcast, picture, view = Broadcast(), NewestPicture(), FingertipView(config.name)
    with (
        notices_for_later(config.name) as notices,
        alternate_screen() as screen,
        closing(open_feed(config, broadcast, picture, notices.add, WIDEST_PX)) as feed,
        broadcast.listen() as listener,
    ):
        commands = PageCommands(feed, picture, Path(config.record.folder) / "snapshots")
        noticed_s = 0.0
        while not stopped.is_set():
            now_s = time.monotonic()
            for event in listener.next(EVENT_S):
                view.take(event, now_s)
            keys = screen.keys(KEY_S)
            if QUIT in keys:
                return
            notice = "".join(_command(key, view, commands) for key in keys[-1:]) or notices.take()
            if notice or now_s - noticed_s > NOTICE_S:
                view.notice, noticed_s = notice, now_s
            screen.draw(lambda *size, at_s=now_s: fingertip_lines(view, at_s, *size))


def _command(key: str, view: FingertipView, commands: PageCommands) -> str:
    """Carry out the command of a key; return what happened, or why not; empty for other keys."""
    is_recording = view.health is not None and view.health.recording != ""
    record = "record_no_more" if is_recording else "record"
    command = record if key == "r" else COMMAND_KEYS.get(key)
    if command is None:
        return ""
    try:
        return commands.run(msgspec.json.encode(PageCommand(command)))
    except PalpateError as error:
        return f"refused: {error}"
