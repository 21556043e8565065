"""Bus load: a budget from the EDS files, and measured load.

Belongs here: bits of a frame, measured load, and the budget of a hand before it is bought. May use: eds and
what it may use.
"""

from palpate_edge.common.lazy_exports import lazy_exports

__all__ = ["BudgetCase", "frame_bits"]

__getattr__ = lazy_exports(__name__, {"bit_count": "frame_bits", "budget": "BudgetCase"})
