"""Decoding of CAN frames to text: names, units and meanings from the EDS.

Belongs here: decoders of PDOs, SDO, EMCY, NMT and LSS. May use: load, eds, logs.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Decoder", "Device"]

__getattr__ = lazy_exports(__name__, {"decoder": "Decoder", "device": "Device"})
