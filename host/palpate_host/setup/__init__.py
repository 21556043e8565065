"""The set-up of a hand: which nodes are on its bus, and the hand.toml that uses them.

Belongs here: sorting found nodes into fingertips and drives, flashing a fingertip's light, the fingers of an
MJCF or URDF file, the text of a hand.toml. May use: service, drives, control, config, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["HandNodes", "fingers_of_model", "hand_toml", "sort_nodes"]

__getattr__ = lazy_exports(
    __name__,
    {
        "found_nodes": "HandNodes sort_nodes",
        "hand_file": "hand_toml",
        "model_fingers": "fingers_of_model",
    },
)
