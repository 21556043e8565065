"""The camera in the dome: rendered frames and press datasets.

Belongs here: bead rendering, light, noise, random sensors. May use: dome.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CameraView", "Look"]

__getattr__ = lazy_exports(__name__, {"renderer": "CameraView", "look": "Look"})
