"""The beads that a kernel measures in one call: all of a layout, or some."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Indices


class ChosenBeads:
    """Beads of a layout; which (n,): their numbers, of which the first ones are chosen."""

    def __init__(self, count: int) -> None:
        """count: of the layout's beads."""
        self.which = np.arange(count, dtype=np.int32)
        self._all = self.which.copy()

    def choose(self, beads: Indices | None, place: Array) -> int:
        """Choose `beads` (m,), all if None, and return how many; place (m, 2): given with them.

        Raises ValueError for beads that the layout does not have, or places of another number of beads.
        """
        chosen = self._all if beads is None else beads
        count, most = len(chosen), len(self._all)
        if place.shape != (count, 2) or count > most:
            raise ValueError(f"{count} beads were given with places of shape {place.shape}")
        if beads is not None and count and not 0 <= beads.min() <= beads.max() < most:
            raise ValueError(f"a bead is not among the {most} of the layout")
        self.which[:count] = chosen
        return count
