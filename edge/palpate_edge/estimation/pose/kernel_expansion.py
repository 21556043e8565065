"""Sums of Gaussian kernels about training points, in single precision, and arrays as the calibration file has
them."""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats


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


class Expansion(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Outputs (k,) of a point (p,): offset + sum over centres of exp(-d^2 / 2) weights.

    metric (p, q): distances d are taken after the product with it. The centres (c, p) are common to several
    expansions; weights (c, k), offset (k,).
    """

    metric: PackedArray
    weights: PackedArray
    offset: PackedArray


class ExpansionRunner:
    """Computes one expansion about centres (c, p)."""

    def __init__(self, expansion: Expansion, centres: Array | Floats) -> None:
        self._metric = expansion.metric.array()
        self._weights, self._offset = expansion.weights.array(), expansion.offset.array()
        self._centres = np.ascontiguousarray(centres @ self._metric, dtype=np.float32)
        self._half = 0.5 * np.square(self._centres).sum(axis=1)

    def at(self, point: Floats) -> Floats:
        """Return the outputs (k,) at one point (p,)."""
        scaled = point @ self._metric
        exponent = self._centres @ scaled - self._half - np.float32(0.5) * (scaled @ scaled)
        return np.asarray(np.exp(np.minimum(exponent, 0)) @ self._weights + self._offset, dtype=np.float32)
