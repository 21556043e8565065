"""Simulated Oriental Motor AZ drives behind a pseudo-terminal.

Belongs here: the drives' registers and the serial line. May use: what drives may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["simulated_port"]

__getattr__ = lazy_exports(__name__, {"az_server": "simulated_port"})
