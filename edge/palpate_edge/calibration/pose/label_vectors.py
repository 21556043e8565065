"""Labels that are vectors in the image: tilt and shear, each with an x and a y, and their senses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.pose.label_axes import PAIRS
from palpate_edge.calibration.pose.transferred import PressesHere
from palpate_edge.common.arrays import Array

LEAST_DETERMINANT = 0.01  # of the correlations of a pair of labels with the markers' mean displacement


class LabelVector(NamedTuple):
    """places: of its x and its y among the labels; sense: 1 where its y follows its x as the image's does, -1
    where it is mirrored, 0 where that is not known."""

    places: tuple[int, int]
    sense: int

    def moved_to(self, place: int) -> LabelVector:
        """Return the vector with its x at a place and its y at the next one."""
        return LabelVector((place, place + 1), self.sense)

    def in_image(self, labels: Array) -> NDArray[np.complex128]:
        """Return the vectors (s,) of labels (s, k), x + i y, with the image's sense and about any axis."""
        return np.asarray(labels[:, self.places] @ np.array([1.0, self.sense * 1j]))

    def parts(self, vectors: Array | NDArray[np.complex128]) -> Array:
        """Return x and y (s, 2) of vectors (s,) as `in_image` returns them."""
        return np.stack([vectors.real, self.sense * vectors.imag], axis=1)


def label_vectors(presses: PressesHere, labels: Sequence[str]) -> list[LabelVector]:
    """Return the vectors among the labels.

    The markers' mean displacement shows their senses: it turns with the vectors of tilt and of shear.
    """
    mean_px = presses.displacement_px.reshape(len(presses.targets), -1, 2).mean(axis=1)
    found = []
    for pair in PAIRS:
        if set(pair) <= set(labels):
            places = labels.index(pair[0]), labels.index(pair[1])
            both = np.corrcoef(presses.targets[:, places], mean_px, rowvar=False)
            determinant = float(np.linalg.det(both[:2, 2:]))
            is_known = abs(determinant) > LEAST_DETERMINANT
            found.append(LabelVector(places, int(np.sign(determinant)) if is_known else 0))
    return found
