"""Learning of the contact fields, and whether the fit of contacts improves a sensor's places.

Belongs here: what only sensors with noisy beads are trained with. May use: what calibration may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["CombinedPlace", "fit_combined_place"]

__getattr__ = lazy_exports(__name__, {"combined_place": "CombinedPlace fit_combined_place"})
