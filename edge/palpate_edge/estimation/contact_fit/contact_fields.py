"""The contact fields: the displacement of one sensor's skin as a function of the contact."""

from __future__ import annotations

import msgspec

from palpate_edge.estimation.pose.kernel_expansion import PackedArray

# A contact as a point (7,): unit vector d of its place, way + d with the unit vector of its force, logarithm
# of the canonical field's size in mm; each times its weight. The kernel is Gaussian, of standard deviation 1.
PLACE_WEIGHT, FORCE_WEIGHT, SIZE_WEIGHT = 2.0, 2.0, 0.3


class ContactFields(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Kernel expansion from contacts to the shapes of their canonical fields.

    centres (c, 7): contacts as points; weights (c, p), offset (p,): coefficients of the shapes; shapes
    (p + 1, 2 g): orthonormal ones and their mean. share: of the fitted place in the combined one;
    radius_scale: 95 % radius of the combined place over that of the correction model.
    """

    centres: PackedArray
    weights: PackedArray
    offset: PackedArray
    shapes: PackedArray
    share: float
    radius_scale: float
