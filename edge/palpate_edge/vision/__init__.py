"""From an image to numbered beads.

Belongs here: blob detection, sub-pixel places, tracking and the registration of a first image; no touch, no
force. May use: geometry, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Appearance", "Beads", "Blobs", "Reference", "Tracker", "find_blobs", "plane"]

__getattr__ = lazy_exports(
    __name__, {"blob_detection": "Appearance Blobs find_blobs plane", "tracker": "Beads Reference Tracker"}
)
