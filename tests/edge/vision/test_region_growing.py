"""Region growing on a lattice of known displacement: beads in a deep dent keep their labels."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.geometry.points import distances
from palpate_edge.vision.neighbourhood import Neighbourhood
from palpate_edge.vision.region_growing import RegionGrowing

SPACING_PX = 17.0


def lattice(shells=10):
    """A TacTip's 331 pins in the plane: a hexagon of ten shells."""
    pairs = [(q, r) for q in range(-shells, shells + 1) for r in range(-shells, shells + 1)]
    pairs = [(q, r) for q, r in pairs if abs(q + r) <= shells]
    return SPACING_PX * np.array([(q + 0.5 * r, np.sqrt(0.75) * r) for q, r in pairs])


REST = lattice()


def dent(depth, width, at=(30.0, -20.0), way=(0.9, 0.4)):
    """REST moved by up to `depth` spacings, a Gaussian of `width` spacings."""
    squared = ((REST - at) ** 2).sum(axis=1) / (width * SPACING_PX) ** 2
    return REST + depth * SPACING_PX * np.exp(-0.5 * squared)[:, None] * np.array(way)


def windows_on(blobs):
    """Return a search that finds the nearest blob within 0.45 spacings of the expected place."""

    def windows(start, _beads):
        apart = distances(start, blobs)
        nearest = apart.argmin(axis=1)
        found = apart[np.arange(len(start)), nearest] < 0.45 * SPACING_PX
        return np.where(found[:, None], blobs[nearest], start), found

    return windows


@pytest.fixture(scope="module")
def growing():
    assert len(REST) == 331
    return RegionGrowing(Neighbourhood(REST))


@pytest.mark.parametrize(("depth", "width"), [(0.8, 3.0), (1.1, 4.0), (1.5, 5.0)])
def test_a_dent_deeper_than_half_a_spacing_is_labelled_right(growing, depth, width):
    blobs = dent(depth, width)
    windows = windows_on(blobs)
    nearest, found = windows(REST, None)
    wrong = found & (np.linalg.norm(nearest - blobs, axis=1) > 1.0)
    assert wrong.any()
    assert growing.is_torn(nearest, found)
    grown, known = growing.grow(nearest, found, windows)
    assert known.mean() > 0.98
    assert np.abs(grown - blobs)[known].max() < 1e-9
    assert not growing.is_torn(grown, known)


def test_a_shallow_dent_is_not_torn(growing):
    assert not growing.is_torn(dent(0.4, 4.0), np.ones(len(REST), dtype=np.bool_))


def test_without_quiet_skin_nothing_is_guessed(growing):
    """The camera was knocked: all beads went as far."""
    moved = REST + np.array([0.45 * SPACING_PX, 0.0])
    found = np.ones(len(REST), dtype=np.bool_)
    grown, known = growing.grow(moved, found, windows_on(moved))
    assert (grown == moved).all()
    assert known.all()
