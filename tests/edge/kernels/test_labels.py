"""Jumps and doubles against their formulas, bead by bead and pair by pair."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate_edge.kernels.labels import LabelKernel

COUNT, LIMIT_PX, OVERLAP_PX, NEAR_PX = 30, 3.0, 2.5, 1.0
REST_PX = np.random.default_rng(0).uniform(0.0, 30.0, (COUNT, 2))
PAIRS = np.triu_indices(COUNT, 1)
FLOATS = st.floats(allow_nan=True, allow_infinity=True)


def kernel():
    overlap_squared = np.full(len(PAIRS[0]), OVERLAP_PX**2)
    return LabelKernel(REST_PX, np.full(COUNT, LIMIT_PX**2), PAIRS, overlap_squared, NEAR_PX**2)


@pytest.mark.parametrize("seed", range(8))
def test_doubles_are_dropped_from_farther(seed):
    random = np.random.default_rng(seed)
    place, last = (REST_PX + random.normal(0.0, 2.0, REST_PX.shape) for _ in range(2))
    found = random.random(COUNT) < 0.8
    kept, step = found.copy(), np.linalg.norm(place - last, axis=1)
    for first, other in zip(*PAIRS, strict=True):
        if found[first] and found[other] and np.linalg.norm(place[first] - place[other]) < OVERLAP_PX:
            kept[first if step[first] > step[other] else other] = False
    checked = found.copy()
    kernel().drop_doubles(place, checked, last)
    assert checked.tolist() == kept.tolist() != found.tolist()
    assert kernel().have_jumped(place, found, last) == (step[found] > LIMIT_PX).any()


def test_beads_near_their_rest_are_no_doubles():
    found, place = np.ones(COUNT, np.bool_), REST_PX + 0.7 * NEAR_PX
    kernel().drop_doubles(place, found, REST_PX)
    assert found.all()
    place[3, 0] += 0.1  # one displacement of the limit, and all pairs are compared
    kernel().drop_doubles(place, found, REST_PX)
    assert not found.all()


@given(st.lists(st.tuples(FLOATS, FLOATS), min_size=COUNT, max_size=COUNT))
@settings(max_examples=50, deadline=None)
def test_any_places_only_clear(places):
    found = np.arange(COUNT) % 3 != 0
    kept = found.copy()
    kernel().drop_doubles(np.array(places), kept, REST_PX)
    assert not (kept & ~found).any()
    kernel().have_jumped(np.array(places), found, REST_PX)
