"""Types at the borders and helpers that every room uses.

Belongs here: values that cross rooms (contact, frame, array types), errors, and small helpers for files,
signals and systemd. May use: the standard library and numpy only.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = [
    "Array",
    "BusError",
    "CalibrationError",
    "CaptureError",
    "ConfigError",
    "Contact",
    "DatasetError",
    "Floats",
    "Frame",
    "Image",
    "Indices",
    "LocalClock",
    "Mask",
    "PalpateError",
    "Plane",
    "Vector3",
]

__getattr__ = lazy_exports(
    __name__,
    {
        "arrays": "Array Floats Image Indices Mask Plane",
        "contact": "Contact Vector3",
        "errors": "PalpateError BusError CalibrationError CaptureError ConfigError DatasetError",
        "frame": "Frame",
        "local_clock": "LocalClock",
    },
)
