"""Cameras: each kind gives frames with the time of their exposure.

Belongs here: the capture protocol and one implementation a kind (V4L2, shared memory). May use: geometry,
common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["ReopeningSource", "RingReader", "RingWriter", "SharedMemorySource", "Source"]

__getattr__ = lazy_exports(
    __name__,
    {
        "source": "Source ReopeningSource",
        "shared_memory": "SharedMemorySource",
        "frame_ring": "RingReader RingWriter",
    },
)
