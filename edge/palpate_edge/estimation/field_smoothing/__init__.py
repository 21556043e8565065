"""Smoothing of a frame's bead displacements by the typical fields of contacts.

Belongs here: the typical fields as the calibration file has them, and the likeliest field of one frame. May
use: what estimation may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["FieldSmoother", "TypicalFields"]

__getattr__ = lazy_exports(__name__, {"smoother": "FieldSmoother", "typical_fields": "TypicalFields"})
