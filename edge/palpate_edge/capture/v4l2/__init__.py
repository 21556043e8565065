"""Cameras of the kernel's Video4Linux2 interface.

Belongs here: ioctls, formats, controls, buffers and names of V4L2 devices. May use: common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CameraSettings", "FixedExposure", "PixelCode", "V4l2Source", "find_camera"]

__getattr__ = lazy_exports(
    __name__,
    {
        "source": "V4l2Source CameraSettings",
        "controls": "FixedExposure",
        "formats": "PixelCode",
        "naming": "find_camera",
    },
)
