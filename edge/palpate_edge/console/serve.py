"""Serve the console of one fingertip until it is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from palpate_edge.console.feed import NewestPicture, PageCommands
from palpate_edge.console.fingertip_pages import PAGE, page_token
from palpate_edge.console.open_feed import open_feed
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import page_files
from palpate_edge.web.serving import serve_page


def serve_console(
    config: FingertipConfig, port: int, stopped: threading.Event, report: Callable[[str], None]
) -> None:
    """Serve the page on 127.0.0.1 until `stopped`; `report` takes the lines for the person who started it.

    A running daemon is watched; without one this process takes the camera. Raises ConfigError when the port
    or the token's file cannot be used, and what `CameraFeed` raises.
    """
    broadcast, picture = Broadcast(), NewestPicture()
    token = page_token(config)
    with closing(open_feed(config, broadcast, picture, report)) as feed:
        commands = PageCommands(feed, picture, Path(config.record.folder) / "snapshots")
        with serve_page(page_files(PAGE, "watch"), port, token, broadcast, commands.run, report):
            stopped.wait()
