"""The silicone dome by finite elements (Fig. 11, Table 2).

Belongs here: mesh, elasticity, contact, and the library of solved presses. May use: palpate_edge.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["Probe", "load_library"]

__getattr__ = lazy_exports(__name__, {"library": "load_library", "probe": "Probe"})
