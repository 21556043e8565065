"""The typical fields: principal displacements of one sensor's beads under contacts of all kinds."""

from __future__ import annotations

import msgspec

from palpate_edge.estimation.pose.kernel_expansion import PackedArray


class TypicalFields(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Principal fields of contacts whose displacement has the mean square 1 px^2 an axis.

    fields (2 n, k): orthonormal, x and y of each bead in turn; variance (k,): of their coefficients;
    remainder: variance of a bead's place along an axis that the k fields leave; smooths_all: whether frames
    are smoothed whose beads were all found and are exact.
    """

    fields: PackedArray
    variance: PackedArray
    remainder: float
    smooths_all: bool = True
