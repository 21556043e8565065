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


def kernel(overlap_px=OVERLAP_PX):
    overlap_squared = np.full(len(PAIRS[0]), overlap_px**2)
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
    result = kernel().check(place, checked, last)
    assert checked.tolist() == kept.tolist() != found.tolist()
    assert result == (np.count_nonzero(~kept), (step[kept] > LIMIT_PX).any())


@pytest.mark.parametrize(("step_px", "jumps"), [(0.99 * LIMIT_PX, False), (1.01 * LIMIT_PX, True)])
def test_one_step_of_a_found_bead_is_a_jump(step_px, jumps):
    found, place = np.ones(COUNT, np.bool_), REST_PX.copy()
    place[4, 1] += step_px
    apart = kernel(overlap_px=0.0)
    assert apart.check(place, found, REST_PX) == (0, jumps)
    found[4] = False
    assert apart.check(place, found, REST_PX) == (1, False)


def test_beads_near_their_rest_are_no_doubles():
    found, place = np.ones(COUNT, np.bool_), REST_PX + 0.7 * NEAR_PX
    kernel().check(place, found, REST_PX)
    assert found.all()
    place[3, 0] += 0.1  # one displacement of the limit, and all pairs are compared
    kernel().check(place, found, REST_PX)
    assert not found.all()


@given(st.lists(st.tuples(FLOATS, FLOATS), min_size=COUNT, max_size=COUNT))
@settings(max_examples=50, deadline=None)
def test_any_places_only_clear(places):
    found = np.arange(COUNT) % 3 != 0
    kept = found.copy()
    lost, _ = kernel().check(np.array(places), kept, REST_PX)
    assert not (kept & ~found).any() and lost == np.count_nonzero(~kept)
