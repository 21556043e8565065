"""Sums of kernels about training points, and arrays as the calibration file has them.

The kernel is Matern's of order 3/2, (1 + sqrt(3) d) exp(-sqrt(3) d): its far reach and its single derivative
fit a skin that sticks here and slips there. The Gaussian of the first calibration files is too smooth.
"""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats

Kernel = Literal["gaussian", "matern"]
ROOT_3 = 3.0**0.5


class PackedArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An array of float32, little-endian."""

    shape: tuple[int, ...]
    data: bytes

    def array(self) -> Floats:
        """Return the array; its memory is read-only."""
        return np.frombuffer(self.data, dtype="<f4").reshape(self.shape)


def packed(values: Array | Floats) -> PackedArray:
    """Return the array as float32."""
    return PackedArray(values.shape, np.ascontiguousarray(values, dtype="<f4").tobytes())


class Expansion(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Outputs (k,) of a point (p,): offset + sum over centres of kernel(d) weights.

    metric (p, q): distances d are taken after the product with it. The centres (c, p) are common to several
    expansions; weights (c, k), offset (k,). kernel: a file without it has the Gaussian exp(-d^2 / 2).
    """

    metric: PackedArray
    weights: PackedArray
    offset: PackedArray
    kernel: Kernel = "gaussian"


def matern(squared: Array) -> Array:
    """Return Matern's kernel of squared distances."""
    distance = np.sqrt(3 * np.maximum(squared, 0))
    return np.asarray((1 + distance) * np.exp(-distance))


class ExpansionRunner:
    """Computes one expansion about centres (c, p): distances in single precision, sums in double, since
    weights of thousands cancel."""

    def __init__(self, expansion: Expansion, centres: Array | Floats) -> None:
        self._metric = expansion.metric.array()
        weights = expansion.weights.array()
        used = weights.any(axis=1)  # the others are centres of other expansions
        self._weights = weights[used].astype(np.float64)
        self._offset = expansion.offset.array()
        self._centres = np.ascontiguousarray(centres[used] @ self._metric, dtype=np.float32)
        self._half = 0.5 * np.square(self._centres).sum(axis=1)
        self._gaussian = expansion.kernel == "gaussian"

    def at(self, point: Floats) -> Floats:
        """Return the outputs (k,) at one point (p,)."""
        scaled = point @ self._metric
        exponent = (self._centres @ scaled - self._half).astype(np.float64) - 0.5 * float(scaled @ scaled)
        near = np.exp(np.minimum(exponent, 0)) if self._gaussian else matern(-2 * exponent)
        return np.asarray(near @ self._weights + self._offset, dtype=np.float32)
