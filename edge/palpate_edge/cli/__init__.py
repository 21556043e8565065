"""The commands of palpate-edge.

Belongs here: arguments and printing, one command a file; work is done in the other rooms. May use: every
room.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["cli"]

__getattr__ = lazy_exports(__name__, {"main": "cli"})
