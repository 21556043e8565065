"""Modes and limits: what the hand may do, and when it stops.

Belongs here: the supervisor, runaway limits, the drives' shutdown; pure. May use: config, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["decide"]

__getattr__ = lazy_exports(__name__, {"supervisor": "decide"})
