"""Hexagonal lattice: the shell of each bead from its lattice coordinates, where some beads are missing.

Beads near the apex are missing where the LEDs reflect from them. Steps along edges then lead around the gap;
lattice coordinates do not depend on the way.
"""

from __future__ import annotations

import numpy as np

from palpate_edge.common.arrays import Array, Indices, Mask

STEPS = np.array([(1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1)])  # in turn, 60 deg apart
MOST_TURNED = 1 / 3  # of 60 deg, between an edge and a direction of the lattice
CONSISTENT = 0.95  # of the edges have such a direction, and join beads that are one step apart
COMPLETE = 0.95  # of the places of all shells hold a bead
LONG_EDGE = 1.6  # in typical edges of the bead that has the shorter ones
NEAR_MEAN = 2  # steps between the middle and the mean place


def lattice_shells(flat: Array, joined: Mask) -> Indices | None:
    """Return the shell (n,) of each bead about the middle of a hexagonal lattice, None for other layouts.

    flat (n, 2): azimuthal equidistant places of the beads; joined (n, n): which are neighbours.
    """
    a, b = np.nonzero(joined & ~_spans_a_gap(flat, joined))
    if not len(a):
        return None
    edge = (flat[b] - flat[a]) @ [1, 1j]
    turn_rad = np.angle(((edge / np.abs(edge)) ** len(STEPS)).mean()) / len(STEPS)
    sixths = (np.angle(edge) - turn_rad) / (np.pi / 3)
    step = STEPS[np.round(sixths).astype(np.intp) % len(STEPS)]
    straight = np.abs(sixths - np.round(sixths)) < MOST_TURNED
    place = _grown(len(flat), a[straight], b[straight], step[straight])
    if place is None or len(np.unique(place, axis=0)) < len(place):
        return None
    right = straight & (place[b] - place[a] == step).all(axis=1)
    shell_of = _about_the_middle(place)
    last = int(shell_of.max())
    complete = len(place) >= COMPLETE * (1 + 3 * last * (last + 1))
    return shell_of if complete and right.mean() >= CONSISTENT else None


def _spans_a_gap(flat: Array, joined: Mask) -> Mask:
    """Return which edges (n, n) are longer than an edge between neighbours of the lattice."""
    length = np.where(joined, np.linalg.norm(flat[:, None] - flat[None], axis=2), np.nan)
    length[~joined.any(axis=1)] = 0.0
    typical = np.nanmedian(length, axis=1)
    return np.asarray(length > LONG_EDGE * np.minimum(typical[:, None], typical[None]))


def _grown(count: int, a: Indices, b: Indices, step: Indices) -> Indices | None:
    """Return the lattice coordinates (count, 2) of all beads, grown from one of most neighbours.

    Bead b (m,) is one `step` (m, 2) from bead a (m,). None where a bead is not joined to the others.
    """
    place = np.zeros((count, 2), dtype=np.intp)
    placed = np.zeros(count, dtype=np.bool_)
    placed[np.bincount(a, minlength=count).argmax()] = True
    while not placed.all():
        grows = placed[a] & ~placed[b]
        if not grows.any():
            return None
        place[b[grows]] = place[a[grows]] + step[grows]
        placed[b[grows]] = True
    return place


def _about_the_middle(place: Indices) -> Indices:
    """Return the steps (n,) from the place near the mean about which there are fewest shells."""
    mean = np.round(place.mean(axis=0)).astype(np.intp)
    near = range(-NEAR_MEAN, NEAR_MEAN + 1)
    every = [lattice_distance(place - mean - np.array([i, j])) for i in near for j in near]
    return min(every, key=lambda steps: (int(steps.max()), int(steps.sum())))


def lattice_distance(place: Indices) -> Indices:
    """Return the number of lattice steps (n,) from the origin to each place (n, 2)."""
    i, j = place.T
    return np.asarray(np.maximum(np.maximum(np.abs(i), np.abs(j)), np.abs(i + j)))
