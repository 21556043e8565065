"""Assignment of candidates to beads: every bead gets at most one, no candidate is given twice."""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.geometry.points import distances
from palpate_edge.vision.neighbourhood import interpolate

NO_PARTNER = -1
GATES = (0.6, 0.5, 0.4)  # of the spacing, one a round: how far a candidate may lie from the prediction


def assign(reference_px: Array, candidates_px: Array, spacing_px: Array) -> Indices:
    """Return for each reference bead (n,) the index of its candidate, or NO_PARTNER.

    reference_px (n, 2); candidates_px (m, 2); spacing_px (n,). Each round pairs mutual nearest neighbours
    within its gate; their displacement, interpolated over the neighbourhood, predicts the places of the
    next round.
    """
    partner = np.full(len(reference_px), NO_PARTNER, dtype=np.intp)
    if len(candidates_px) == 0:
        return partner
    predicted = reference_px
    for gate in GATES:
        distance = distances(predicted, candidates_px)
        nearest_candidate = distance.argmin(axis=1)
        nearest_bead = distance.argmin(axis=0)
        beads = np.arange(len(reference_px))
        mutual = nearest_bead[nearest_candidate] == beads
        mutual &= distance[beads, nearest_candidate] < gate * spacing_px
        partner = np.where(mutual, nearest_candidate, NO_PARTNER).astype(np.intp)
        if not mutual.any():
            break
        displacement = candidates_px[partner[mutual]] - reference_px[mutual]
        relative = distances(reference_px, reference_px[mutual]) / spacing_px[:, None]
        predicted = reference_px + interpolate(relative, displacement)
    return partner
