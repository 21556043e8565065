"""Correspondence on lattices of known displacement: no bead gets its neighbour's blob."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.geometry.points import distances
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.correspondence import Correspondence
from palpate_edge.vision.neighbourhood import Neighbourhood

SPACING_PX = 17.0


def lattice(shells=10):
    """A TacTip's 331 pins in the plane: a hexagon of ten shells."""
    pairs = [(q, r) for q in range(-shells, shells + 1) for r in range(-shells, shells + 1)]
    pairs = [(q, r) for q, r in pairs if abs(q + r) <= shells]
    return np.array([320.0, 240.0]) + SPACING_PX * np.array(
        [(q + 0.5 * r, np.sqrt(0.75) * r) for q, r in pairs]
    )


REST = lattice()


def dent(depth, width, at=(350.0, 220.0), way=(0.9, 0.4)):
    """REST moved by up to `depth` spacings, a Gaussian of `width` spacings."""
    squared = ((REST - at) ** 2).sum(axis=1) / (width * SPACING_PX) ** 2
    return REST + depth * SPACING_PX * np.exp(-0.5 * squared)[:, None] * np.array(way)


def strong(place_px):
    return Blobs(place_px, np.full(len(place_px), 40.0))


def match(blobs, *hypotheses):
    return Correspondence(Neighbourhood(REST)).match(blobs, np.stack(hypotheses or (REST,)))


@pytest.mark.parametrize(("depth", "width"), [(0.3, 3.0), (0.8, 3.0), (1.1, 4.0), (1.5, 5.0)])
def test_a_dent_deeper_than_half_a_spacing_is_labelled_right(depth, width):
    place = dent(depth, width)
    order = np.random.default_rng(4).permutation(331)
    found = match(strong(place[order]))
    assert found.found.all()
    assert (order[found.blob] == np.arange(331)).all()
    assert found.doubt == 0.0


def test_with_a_history_a_row_off_the_reference_wins():
    """From the history every bead but those of one side finds a neighbour's blob."""
    aside = np.array([SPACING_PX, 0.0])
    found = match(strong(REST), REST + aside, REST)
    assert (found.blob == np.arange(331)).all()
    assert found.doubt == 0.0


def test_with_nothing_but_a_history_a_row_off_the_labels_are_doubted():
    aside = np.array([SPACING_PX, 0.0])
    found = match(strong(REST), REST + aside)
    assert found.doubt > 0.02


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), hidden=st.integers(0, 60), specks=st.integers(0, 30))
def test_hidden_beads_and_specks_give_no_wrong_label(seed, hidden, specks):
    """A bead gets its own blob or none; a speck at a hidden bead's place is all that may stand in for it."""
    random = np.random.default_rng(seed)
    place = dent(random.uniform(0.0, 0.7), random.uniform(3.0, 5.0), random.uniform(150, 400, 2))
    seen = random.permutation(331)[hidden:]
    noise = random.uniform((60, 60), (580, 420), (specks, 2))
    noise = noise[distances(noise, place).min(axis=1) > 0.4 * SPACING_PX] if specks else noise
    blobs = Blobs(np.concatenate([place[seen], noise]), np.full(len(seen) + len(noise), 40.0))
    found = match(blobs)
    measured = blobs.position_px[found.blob[found.found]]
    assert np.linalg.norm(measured - place[found.found], axis=1).max() < 1e-9 + 0.6 * SPACING_PX * bool(
        specks
    )
    assert found.found[seen].mean() > 0.9  # a bead among hidden ones has no neighbours that predict it


def test_without_blobs_there_are_no_labels():
    found = match(strong(np.zeros((0, 2))))
    assert not found.found.any()
    assert (found.predicted_px == REST).all()
    assert found.doubt == 1.0
