"""hand.toml and its kin: read once, checked whole, immutable.

Belongs here: configuration types and the hands that ship with the package. May use: common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["MODELS", "HandConfig", "load"]

__getattr__ = lazy_exports(
    __name__, {"hand_config": "HandConfig", "hand_reader": "load", "packaged": "MODELS"}
)
