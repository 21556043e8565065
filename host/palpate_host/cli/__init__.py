"""The commands of palpate-host.

Belongs here: arguments and printing, one command a file. May use: every room of the host; the twin's
commands come by entry point.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["cli"]

__getattr__ = lazy_exports(__name__, {"main": "cli"})
