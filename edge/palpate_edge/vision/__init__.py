"""From an image to numbered beads.

Belongs here: blob detection, sub-pixel places, tracking and the registration of a first image; no touch, no
force. May use: geometry, kernels, common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Appearance", "Beads", "Blobs", "Reference", "Tracker", "find_blobs", "plane"]

__getattr__ = lazy_exports(
    __name__,
    {
        "appearance": "Appearance plane",
        "beads": "Beads Reference",
        "blob_detection": "Blobs find_blobs",
        "tracker": "Tracker",
    },
)
