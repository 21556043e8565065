"""Electronic data sheets (CiA 306), of any vendor.

Belongs here: reading and checking EDS files, and the CiA 402 profile. May use: palpate_edge.common,
can_bus, node.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "CIA402_EDS",
    "Controlword",
    "DriveState",
    "parse_sections",
    "read_objects",
    "read_text",
    "state_of",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "cia402": "CIA402_EDS Controlword DriveState state_of",
        "objects": "read_objects",
        "text": "parse_sections read_text",
    },
)
