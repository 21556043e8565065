"""The console of one fingertip: its page in the browser, and what feeds it.

Belongs here: pictures and health from a running daemon or from the camera, the page's files, the
view in the terminal, and the page of a press-rig run. May use: web, guide and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CameraFeed", "DaemonFeed", "serve_console"]

__getattr__ = lazy_exports(
    __name__,
    {"camera_feed": "CameraFeed", "daemon_feed": "DaemonFeed", "serve": "serve_console"},
)
