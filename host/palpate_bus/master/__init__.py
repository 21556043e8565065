"""Requests to nodes: scan, SDO access, LSS, checks against an EDS.

Belongs here: everything that a master does with the nodes of a live bus. May use: decode, hub, load, eds,
logs.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["LssAddress", "find_unconfigured", "sdo_client", "set_node_id"]

__getattr__ = lazy_exports(
    __name__, {"session": "sdo_client", "lss": "LssAddress find_unconfigured set_node_id"}
)
