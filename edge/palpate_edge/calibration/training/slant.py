"""Slants: forces along the surface that a wall adds where its stiffness has a slope.

A press beside a stiffer place is pushed away from it, and no canonical frame knows where that is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from palpate_edge.calibration.training.dome_model import MIRROR
from palpate_edge.calibration.training.samples import Samples, TrainingPress
from palpate_edge.common.arrays import Array

LEAST_SIZE = 1e-9  # N, of a force that has a direction


def frames_in_sensor(samples: Samples, presses: Sequence[TrainingPress]) -> Array:
    """Return the matrices (s, 3, 3) that bring the samples' canonical frames, mirrored ones as well, to F.

    The presses have known forces: place and force show the turn.
    """
    places, forces = _places(presses)[samples.press], _unit(_forces_N(presses))[samples.press]
    own = _unit(samples.forces_N)
    plain, mirrored = (
        _complex(places) * np.conj(_complex(samples.directions * signs))
        + _complex(forces) * np.conj(_complex(own * signs))
        for signs in (np.ones(3), MIRROR)
    )
    is_mirrored = np.abs(mirrored) > np.abs(plain)
    angle = np.angle(np.where(is_mirrored, mirrored, plain))
    frames = np.zeros((len(angle), 3, 3))
    frames[:, 0, 0], frames[:, 0, 1] = np.cos(angle), -np.sin(angle)
    frames[:, 1, 0], frames[:, 1, 1] = np.sin(angle), np.cos(angle)
    frames[:, 2, 2] = 1.0
    frames[is_mirrored, :, 1] *= -1.0
    return frames


def missing_slants(
    given_N: Array, samples: Samples, presses: Sequence[TrainingPress], frames: Array
) -> Array:
    """Return the forces (c, 3) along the surface that presses have beyond the given ones (s, 3) of their
    plain samples, over the size of these."""
    plain = np.flatnonzero(samples.plain)
    summed_N = np.zeros((len(presses), 3))
    np.add.at(summed_N, samples.press[plain], np.matvec(frames[plain], given_N[plain]))
    count = np.bincount(samples.press[plain], minlength=len(presses))
    mean_N = summed_N / np.maximum(count, 1)[:, None]
    return along(_forces_N(presses) - mean_N, _places(presses)) / _size(mean_N)


def slanted(given_N: Array, slants: Array, frames: Array) -> Array:
    """Return the given forces (s, 3) with slants (s, 3) in F."""
    return np.asarray(given_N + _size(given_N) * np.vecmat(slants, frames))


def along(vectors: Array, places: Array) -> Array:
    """Return the parts of vectors (c, 3) along the surface at places (c, 3), unit vectors."""
    return np.asarray(vectors - np.vecdot(vectors, places)[:, None] * places)


def _places(presses: Sequence[TrainingPress]) -> Array:
    return np.array([press.direction for press in presses])


def _forces_N(presses: Sequence[TrainingPress]) -> Array:
    return np.array([press.force_N for press in presses], dtype=np.float64)


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / _size(vectors))


def _size(vectors: Array) -> Array:
    return np.asarray(np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), LEAST_SIZE))


def _complex(vectors: Array) -> NDArray[np.complex128]:
    return np.asarray(vectors[:, 0] + 1j * vectors[:, 1])
