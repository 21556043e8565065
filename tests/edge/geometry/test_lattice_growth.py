"""Growth of a hexagonal lattice: hexagons bent as lenses, domes and presses bend them, with false spots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from palpate_edge.geometry.lattice_growth import NO_SPOT, hexagon_spots

PITCH_PX = 18.0
MIDDLE_PX = np.array([320.0, 240.0])


def hexagon_px(shells):
    """Places (m, 2) of a flat hexagon, in rows."""
    every = range(-shells, shells + 1)
    return PITCH_PX * np.array(
        [(i + 0.5 * j, np.sqrt(0.75) * j) for i in every for j in every if abs(i + j) <= shells]
    )


def as_circles(flat_px):
    """Each shell becomes a ring of the same spacing all round, as on a TacTip."""
    x, y = flat_px.T
    shell = np.maximum.reduce([np.abs(x - y / 3**0.5), np.abs(2 * y / 3**0.5), np.abs(x + y / 3**0.5)])
    angle = np.arctan2(y, x)
    along = np.mod(angle, np.pi / 3) - np.pi / 6
    share = 0.5 + np.tan(along) / (2 * np.tan(np.pi / 6))  # of the shell's side
    turned = (np.floor(angle / (np.pi / 3)) + share) * np.pi / 3
    return shell[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)


def as_lens(flat_px):
    """A barrel that brings the border nearer by a fifth."""
    squared = (flat_px**2).sum(axis=1) / (flat_px**2).sum(axis=1).max()
    return flat_px * (1.0 - 0.2 * squared)[:, None]


def pressed(flat_px, seed):
    """A dent that moves markers by up to 0.8 of the pitch."""
    random = np.random.default_rng(seed)
    at, way = random.uniform(-90, 90, 2), random.normal(0, 1, 2)
    depth = np.exp(-0.5 * ((flat_px - at) ** 2).sum(axis=1) / (4 * PITCH_PX) ** 2)
    return flat_px + 0.8 * PITCH_PX * depth[:, None] * way / np.linalg.norm(way)


def picture(places_px, seed, hidden=0, false=0):
    """Spots of the places in any order, turned, some hidden; false ones lie beside the hexagon or between."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0, 2 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    truth = places_px @ turn.T + MIDDLE_PX
    seen = np.delete(truth, random.choice(len(truth), hidden, replace=False), axis=0)
    reach = np.abs(places_px).max() * 1.4
    spots = np.vstack([seen, random.uniform(-reach, reach, (false, 2)) + MIDDLE_PX])
    spots += random.normal(0, 0.03 * PITCH_PX, spots.shape)
    return truth, spots[random.permutation(len(spots))]


def wrong(found, truth, tolerance):
    """The number of markers that are at no place of the truth, or at another marker's."""
    apart = np.linalg.norm(found.position_px[:, None] - truth[None], axis=2)
    nearest = apart.argmin(axis=1)
    off = apart.min(axis=1) > tolerance * PITCH_PX
    return int(off.sum()) + len(truth) - len(np.unique(nearest))


@pytest.mark.parametrize("shells", [2, 5, 10])
@pytest.mark.parametrize("bend", [lambda px: px, as_circles, as_lens])
@pytest.mark.parametrize("seed", range(3))
def test_every_marker_is_found_among_false_spots(shells, bend, seed):
    count = 1 + 3 * shells * (shells + 1)
    truth, spots = picture(bend(hexagon_px(shells)), seed, false=count // 10)
    found = hexagon_spots(spots, np.ones(len(spots)), count)
    assert (found.seen, wrong(found, truth, 0.3)) == (count, 0)
    np.testing.assert_array_equal(found.position_px, spots[found.spot])


@pytest.mark.parametrize("bend", [lambda px: px, as_circles])
@pytest.mark.parametrize("seed", range(6))
def test_hidden_markers_are_where_the_others_show_under_a_press(bend, seed):
    truth, spots = picture(bend(pressed(hexagon_px(10), seed)), seed, hidden=12)
    found = hexagon_spots(spots, np.ones(len(spots)), 331)
    hidden = found.spot == NO_SPOT
    assert found.seen == 331 - 12
    assert wrong(found, truth, 0.7) == 0
    apart = np.linalg.norm(found.position_px[hidden][:, None] - truth[None], axis=2).min(axis=1)
    assert np.median(apart) < 0.2 * PITCH_PX


def test_a_weak_spot_takes_no_marker_s_place():
    truth, spots = picture(hexagon_px(5), 1, hidden=1)
    hidden = truth[np.linalg.norm(truth[:, None] - spots[None], axis=2).min(axis=1).argmax()]
    spots = np.vstack([spots, hidden + np.array([0.3 * PITCH_PX, 0.0])])
    for weak, seen in ((0.2, 90), (0.3, 91)):
        assert hexagon_spots(spots, np.append(np.ones(90), weak), 91).seen == seen


def test_a_spot_outside_the_hexagon_is_no_marker():
    truth, spots = picture(hexagon_px(5), 1, hidden=1)
    middle = truth.mean(axis=0)
    outside = middle + 1.2 * (truth[0] - middle)
    found = hexagon_spots(np.vstack([spots, outside]), np.ones(len(spots) + 1), 91)
    assert len(spots) not in found.spot


@pytest.mark.parametrize(
    "spots", [np.zeros((0, 2)), np.zeros((6, 2)), np.ones((40, 2)), hexagon_px(1)[:, :1] * 2]
)
def test_spots_without_a_lattice_give_none_or_few(spots):
    spots = np.hstack([spots, spots])[:, :2]
    found = hexagon_spots(spots, np.ones(len(spots)), 91)
    assert found is None or found.seen < 60


@given(
    arrays(np.float64, st.tuples(st.integers(0, 40), st.just(2)), elements=st.floats(0.0, 640.0)),
    st.integers(1, 4),
)
@settings(max_examples=50, deadline=None)
def test_any_spots_give_a_hexagon_of_finite_places_or_none(spots, shells):
    count = 1 + 3 * shells * (shells + 1)
    found = hexagon_spots(spots, np.ones(len(spots)), count)
    if found is not None:
        assert found.position_px.shape == (count, 2)
        assert np.isfinite(found.position_px).all()
        used = found.spot[found.spot != NO_SPOT]
        assert len(np.unique(used)) == len(used)
