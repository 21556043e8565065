"""Corrections of the correction model's answer, as one sensor's own presses teach them.

Belongs here: the fields of contacts and the stiffness by place as the calibration file has them, and the fit
of a contact to the measured displacement of noisy beads. May use: what estimation may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["ContactFields", "ContactFitter", "PlaceStiffness"]

__getattr__ = lazy_exports(
    __name__,
    {
        "contact_fields": "ContactFields",
        "contact_fitter": "ContactFitter",
        "place_stiffness": "PlaceStiffness",
    },
)
