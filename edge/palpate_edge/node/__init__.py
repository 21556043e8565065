"""The CANopen slave core: one CiA 301 service a file, frames and time in, frames out.

Belongs here: object dictionary, services and the fingertip's objects; no clock, socket or thread. May use:
can_bus (the frame type) and common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "FINGERTIP_EDS",
    "Entry",
    "FingertipNode",
    "NmtCommand",
    "NmtState",
    "ObjectDictionary",
    "PdoCodec",
    "Slave",
    "load_eds",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "slave": "Slave",
        "fingertip": "FingertipNode",
        "eds": "load_eds",
        "parsed_eds": "FINGERTIP_EDS",
        "object_dictionary": "ObjectDictionary Entry",
        "pdo_codec": "PdoCodec",
        "nmt": "NmtCommand NmtState",
    },
)
