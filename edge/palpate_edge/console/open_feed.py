"""Choose the feed of a fingertip's console: its running daemon, else the camera."""

from __future__ import annotations

from collections.abc import Callable

from palpate_edge.console.camera_feed import CameraFeed
from palpate_edge.console.daemon_feed import DaemonFeed, connect_daemon
from palpate_edge.console.feed import Feed, NewestPicture
from palpate_edge.console.pictures import WIDEST_PX
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.watching.watch_messages import watch_paths
from palpate_edge.web.broadcast import Broadcast


def open_feed(
    config: FingertipConfig,
    broadcast: Broadcast,
    picture: NewestPicture,
    report: Callable[[str], None],
    widest_px: int = WIDEST_PX,
) -> Feed:
    """Return the feed; `report` takes a line about it, `widest_px` limits the width of published pictures.

    Raises what `CameraFeed` raises.
    """
    paths = watch_paths(config.name, config.health)
    connection = connect_daemon(paths)
    if connection is None:
        report(f"{config.name}: no daemon runs; this console takes the camera, without the bus")
        return CameraFeed(config, report, broadcast, picture, widest_px)
    connection.close()
    report(f"{config.name}: a daemon runs and has the camera")
    return DaemonFeed(
        config.name, config.capture.timeout_ms, lambda: connect_daemon(paths), broadcast, picture, widest_px
    )
