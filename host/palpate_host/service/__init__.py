"""The host's process: receive, decide, send, tick by tick.

Belongs here: the core, its bus, status stream, checks of a hand, replay of a log. May use: network,
operator and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["HostCore", "run"]

__getattr__ = lazy_exports(__name__, {"host_core": "HostCore", "host": "run"})
