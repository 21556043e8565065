"""The object's pose by an external camera (Fig. 18).

Belongs here: markers, intrinsics, tracking of the object. May use: service and below, palpate_edge.capture.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Intrinsics", "MarkerCamera", "ObjectTracker", "read_intrinsics"]

__getattr__ = lazy_exports(
    __name__, {"track": "ObjectTracker", "marker": "MarkerCamera", "intrinsics": "Intrinsics read_intrinsics"}
)
