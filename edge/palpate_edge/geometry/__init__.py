"""The sensor's geometry: dome, lens, bead layout.

Belongs here: pixels to points on the dome and back, camera pose, layouts and their triangulation. May use:
common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "Camera",
    "CameraPose",
    "Dome",
    "MarkerLayout",
    "Markers",
    "Ring",
    "Sensor",
    "View",
    "delaunay",
    "learn_layout",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "sensor": "Camera CameraPose Dome Markers Ring Sensor View",
        "marker_layout": "MarkerLayout learn_layout",
        "triangulation": "delaunay",
    },
)
