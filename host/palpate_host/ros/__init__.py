"""The bridge to ROS 2: a running hand's topics and services, and its URDF.

Belongs here: contents of messages as plain values, the node made with rclpy. May use: recording and below.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["HandContents", "urdf_of"]

__getattr__ = lazy_exports(__name__, {"contents": "HandContents", "urdf": "urdf_of"})
