"""Serve the console of one fingertip until it is stopped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from palpate_edge.console.camera_feed import CameraFeed
from palpate_edge.console.daemon_feed import DaemonFeed, connect_daemon
from palpate_edge.console.feed import Feed, NewestPicture, PageCommands
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.health import health_path
from palpate_edge.daemon.watching.watch_messages import watch_paths
from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import addresses, page_files
from palpate_edge.web.server import ConsoleServer
from palpate_edge.web.token_file import read_or_make_token

PAGE = Path(__file__).parent / "page"


def serve_console(
    config: FingertipConfig, port: int, stopped: threading.Event, report: Callable[[str], None]
) -> None:
    """Serve the page on 127.0.0.1 until `stopped`; `report` takes the lines for the person who started it.

    A running daemon is watched; without one this process takes the camera. Raises ConfigError when the port
    or the token's file cannot be used, and what `CameraFeed` raises.
    """
    broadcast, picture = Broadcast(), NewestPicture()
    health = health_path(config.name, config.health)
    token = read_or_make_token(health.with_name(f"{health.stem}.token"))
    with closing(_open_feed(config, broadcast, picture, report)) as feed:
        commands = PageCommands(feed, picture, Path(config.record.folder) / "snapshots")
        server = ConsoleServer(port, token, page_files(PAGE, "watch"), broadcast, commands.run)
        with server.serving():
            for line in addresses(server.port, token):
                report(line)
            stopped.wait()


def _open_feed(
    config: FingertipConfig, broadcast: Broadcast, picture: NewestPicture, report: Callable[[str], None]
) -> Feed:
    paths = watch_paths(config.name, config.health)
    connection = connect_daemon(paths)
    if connection is None:
        report(f"{config.name}: no daemon runs; this console takes the camera, without the bus")
        return CameraFeed(config, report, broadcast, picture)
    connection.close()
    report(f"{config.name}: a daemon runs and has the camera")
    return DaemonFeed(
        config.name, config.capture.timeout_ms, lambda: connect_daemon(paths), broadcast, picture
    )
