"""The commands of palpate-host bus.

Belongs here: arguments and printing. May use: every room of palpate_bus.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["bus"]

__getattr__ = lazy_exports(__name__, {"main": "bus"})
