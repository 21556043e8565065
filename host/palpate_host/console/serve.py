"""Serve the console of a hand until it is stopped."""

from __future__ import annotations

import os
import tempfile
import threading
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import page_files
from palpate_edge.web.serving import serve_page
from palpate_edge.web.token_file import read_or_make_token
from palpate_host.config.hand_config import HandConfig
from palpate_host.console.bus_feed import BusFeed
from palpate_host.console.hand_feed import HandFeed
from palpate_host.console.hand_scene import SceneMaker
from palpate_host.console.recordings import Recordings

PAGE = Path(__file__).parent / "page"


def token_path() -> Path:
    """Return the path of the token's file, in the user's run directory or that for temporary files."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    return Path(folder) / f"palpate-hand-{os.getuid()}.token"


def serve_hand(
    config: HandConfig,
    socket_path: Path,
    recordings_folder: Path,
    port: int,
    stopped: threading.Event,
    report: Callable[[str], None],
) -> None:
    """Serve the page on 127.0.0.1 until `stopped`; `report` takes the lines for the person who started it.

    recordings_folder: of the recordings that the page makes and plays; the first one creates it.
    Raises ConfigError when the port, the token's file or the hand's model cannot be used.
    """
    broadcast = Broadcast()
    scenes, token = SceneMaker(config), read_or_make_token(token_path())
    with (
        closing(Recordings(recordings_folder, config, socket_path, broadcast)) as recordings,
        closing(BusFeed(config, broadcast)),
        closing(HandFeed(socket_path, scenes, broadcast, recordings)) as feed,
        serve_page(page_files(PAGE, "hand"), port, token, broadcast, feed.run, report),
    ):
        stopped.wait()
