"""Compiled kernels: the loops over beads, samples and blobs of every frame, in C.

Belongs here: C sources that compute and allocate nothing, and for each a Python module of its name that
gives it arrays and takes its results; no method of its own, the rooms that use a kernel describe it. May use:
common.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["address", "kernel"]

__getattr__ = lazy_exports(__name__, {"library": "address kernel"})
