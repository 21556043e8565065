"""Pages in the browser, served on loopback: shared by the consoles of fingertip and hand.

Belongs here: the HTTP server with its checks of host, origin and token, the stream of events, the scripts and
styles that both pages use. May use: common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Broadcast", "ConsoleServer", "read_or_make_token"]

__getattr__ = lazy_exports(
    __name__,
    {"broadcast": "Broadcast", "server": "ConsoleServer", "token_file": "read_or_make_token"},
)
