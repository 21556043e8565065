"""Training of the networks that correct labels, by absolute errors.

Each network is trained without one part of the presses and predicts that part; the estimator takes the mean
of all. Absolute errors, since a label that the skin no longer follows is far from normal: its median is the
better guess. The steps are Adam's (Kingma and Ba, 2015), with decay of the weights apart from them
(Loshchilov and Hutter, 2019), and go to 0 along a cosine.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from palpate_edge.common.arrays import Array, Floats
from palpate_edge.estimation.pose.kernel_expansion import packed
from palpate_edge.estimation.pose.network import NetworkLayer, Networks, layer_outputs

PARTS = 5  # and networks
HIDDEN = (64, 64)
EPOCHS, BATCH = 200, 64
STEP, DECAY = 3e-3, 0.2
MOMENTUM, SQUARES = 0.9, 0.999
NEARLY_ZERO = 0.1  # deviations; the gradient of a smaller error is in proportion to it


@dataclass(frozen=True, slots=True)
class NetworkFit:
    """Trained networks, and the correction (s, k) of each press by the network that has not seen it."""

    networks: Networks
    left_out: Array


def fit_networks(inputs: Array, targets: Array, labels: list[int]) -> NetworkFit:
    """Train networks to give targets (s, k), corrections of `labels`, from inputs (s, i)."""
    mean, scale = inputs.mean(axis=0), 1 / np.maximum(inputs.std(axis=0), 1e-12)
    size = np.maximum(targets.std(axis=0), 1e-12)
    scaled = ((inputs - mean) * scale).astype(np.float32)
    layers = _train(scaled, (targets / size).astype(np.float32))
    left_out = np.empty_like(targets)
    outputs = layer_outputs(layers, scaled[None])[-1]
    for part in range(PARTS):
        left_out[part::PARTS] = outputs[part, part::PARTS] * size
    packed_layers = tuple(NetworkLayer(packed(weights), packed(bias)) for weights, bias in layers)
    networks = Networks(tuple(labels), packed(mean), packed(scale), packed_layers, packed(size))
    return NetworkFit(networks, left_out)


def _train(inputs: Floats, targets: Floats) -> list[tuple[Floats, Floats]]:
    """Return the layers of `PARTS` networks, each trained without every fifth of the presses (s,)."""
    random = np.random.default_rng(0)
    places = np.arange(len(inputs))
    seen = [places[places % PARTS != part] for part in range(PARTS)]
    batches = min(map(len, seen)) // BATCH
    values = _first_values(random, (inputs.shape[1], *HIDDEN, targets.shape[1]))
    momentum, squares = ([np.zeros_like(value) for value in values] for _ in range(2))
    for step in range(1, EPOCHS * batches + 1):
        if step % batches == 1 or batches == 1:
            order = np.array([random.permutation(some)[: batches * BATCH] for some in seen])
        start = (step - 1) % batches * BATCH
        batch = order[:, start : start + BATCH]
        size = STEP * 0.5 * (1 + np.cos(np.pi * step / (EPOCHS * batches)))
        for place, slope in enumerate(_slopes(values, inputs[batch], targets[batch])):
            momentum[place] += (1 - MOMENTUM) * (slope - momentum[place])
            squares[place] += (1 - SQUARES) * (slope**2 - squares[place])
            move = momentum[place] / (1 - MOMENTUM**step)
            move /= np.sqrt(squares[place] / (1 - SQUARES**step)) + 1e-8
            if place % 2 == 0:  # weights, not biases
                move += DECAY * values[place]
            values[place] -= size * move
    return _layers(values)


def _first_values(random: np.random.Generator, sizes: tuple[int, ...]) -> list[Floats]:
    """Return random weights (e, i, o) and biases (e, 1, o) of 0, in turn."""
    values = []
    for before, after in itertools.pairwise(sizes):
        values.append((random.normal(size=(PARTS, before, after)) / np.sqrt(before)).astype(np.float32))
        values.append(np.zeros((PARTS, 1, after), dtype=np.float32))
    return values


def _layers(values: list[Floats]) -> list[tuple[Floats, Floats]]:
    return list(zip(values[::2], values[1::2], strict=True))


def _slopes(values: list[Floats], inputs: Floats, targets: Floats) -> list[Floats]:
    """Return the gradient of the mean absolute error by each of the values; inputs (e, s, i)."""
    layers = _layers(values)
    outputs = layer_outputs(layers, inputs)
    error = np.clip((outputs[-1] - targets) / NEARLY_ZERO, -1, 1) / inputs.shape[1]
    slopes: list[Floats] = []
    for number in range(len(layers) - 1, -1, -1):
        before = outputs[number - 1] if number else inputs
        slopes = [before.transpose(0, 2, 1) @ error, error.sum(axis=1, keepdims=True), *slopes]
        if number:
            error = (error @ layers[number][0].transpose(0, 2, 1)) * (1 - before**2)
    return slopes
