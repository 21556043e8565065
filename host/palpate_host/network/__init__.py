"""The other nodes of the bus as the host knows them.

Belongs here: NMT master, fingertips' contacts, joint history. May use: drives, safety, control, config,
common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Fingertip", "Nodes"]

__getattr__ = lazy_exports(__name__, {"nodes": "Nodes", "fingertips": "Fingertip"})
