"""Small networks that correct labels which saturate.

Where the skin slips, shear and torsion no longer move it, and what they were follows from all labels
together, in a way that is no smooth sum over neighbouring presses. Inputs of the networks are the labels by
the first regression and those by the local ones; their mean output is added to the labels.
"""

from __future__ import annotations

import msgspec
import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.estimation.pose.kernel_expansion import PackedArray


class NetworkLayer(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One layer of `e` networks: weights (e, i, o) and bias (e, 1, o)."""

    weights: PackedArray
    bias: PackedArray


class Networks(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Networks with tanh between their layers.

    labels: places of the labels (k,) that are corrected; mean and scale (i,): inputs are (value - mean)
    scale; size (k,): outputs are multiplied with it.
    """

    labels: tuple[int, ...]
    mean: PackedArray
    scale: PackedArray
    layers: tuple[NetworkLayer, ...]
    size: PackedArray


def layer_outputs(layers: list[tuple[Floats, Floats]], inputs: Floats) -> list[Floats]:
    """Return the outputs (e, s, o) of each layer of (weights, bias) for inputs (e, s, i)."""
    outputs = []
    for number, (weights, bias) in enumerate(layers, start=1):
        inputs = inputs @ weights + bias
        outputs.append(inputs if number == len(layers) else np.tanh(inputs))
        inputs = outputs[-1]
    return outputs


class NetworkRunner:
    """Computes the mean output of networks."""

    def __init__(self, networks: Networks) -> None:
        self.labels = list(networks.labels)
        self._mean, self._scale = networks.mean.array(), networks.scale.array()
        self._layers = [(layer.weights.array(), layer.bias.array()) for layer in networks.layers]
        self._size = networks.size.array()

    def at(self, inputs: Array | Floats) -> Floats:
        """Return the corrections (k,) for one set of inputs (i,)."""
        scaled = ((inputs - self._mean) * self._scale).astype(np.float32)[None, None]
        outputs = layer_outputs(self._layers, scaled)[-1]
        return np.asarray(outputs.mean(axis=(0, 1)) * self._size, dtype=np.float32)
