"""Fit of a contact to the measured displacement of noisy beads.

Belongs here: the fields of contacts as the calibration file has them, and the fit of one frame. May use: what
estimation may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["ContactFields", "ContactFitter"]

__getattr__ = lazy_exports(__name__, {"contact_fields": "ContactFields", "contact_fitter": "ContactFitter"})
