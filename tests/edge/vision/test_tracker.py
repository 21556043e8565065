"""Tracking: every bead keeps its number; a hidden bead is reported lost and found again later."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from palpate_edge.geometry.points import distances
from palpate_edge.vision.appearance import Appearance, plane
from palpate_edge.vision.assignment import NO_PARTNER, assign
from palpate_edge.vision.beads import Reference
from palpate_edge.vision.neighbourhood import interpolate
from palpate_edge.vision.tracker import Tracker

SPACING_PX = 22.0


def grid(side=7):
    place = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2).astype(float)
    return 60 + SPACING_PX * place


@pytest.fixture(scope="module")
def skin(another_dome):
    """A flat skin of 49 beads of 9 px, 22 px apart: (reference, draw(places, hidden))."""
    dome = another_dome(width=256, height=256, noise=1.5)

    def draw(places, hidden=(), seed=1):
        picture = dome.draw(places, np.full(len(places), 9.0), seed, hidden)
        return plane(picture, Appearance())

    count = len(grid())
    reference = Reference(grid(), np.full(count, 9.0), np.full(count, 110.0), np.ones(count))
    return reference, draw


def sheared(places, amount_px):
    """Shear along x: the last row moves by `amount_px`, the middle one not at all."""
    height = np.ptp(places[:, 1]) / 2
    return places + np.stack([amount_px * (places[:, 1] - places[:, 1].mean()) / height, 0 * places[:, 0]], 1)


def bulged(places, amount_px):
    """Beads pushed away from the middle, the most at one and a half spacings from it."""
    away = places - places.mean(axis=0)
    scaled = away / (1.5 * SPACING_PX)
    return places + amount_px * scaled * np.exp(0.5 - 0.5 * (scaled**2).sum(axis=1, keepdims=True))


@pytest.mark.parametrize("move", [sheared, bulged])
@pytest.mark.parametrize("share", [0.1, 0.25, 0.45, -0.45])
def test_labels_stay_in_one_jump(skin, move, share):
    reference, draw = skin
    places = move(grid(), share * SPACING_PX)
    beads = Tracker(reference).follow(draw(places))
    error = np.linalg.norm(beads.position_px - places, axis=1)
    assert (error[beads.found] < 0.3).all()  # a bead reported as found is the right one
    assert beads.found.mean() > 0.95


@pytest.mark.parametrize("move", [sheared, bulged])
def test_labels_stay_over_many_small_steps_beyond_a_spacing(skin, move):
    reference, draw = skin
    tracker = Tracker(reference)
    for share in np.linspace(0, 1.2 if move is sheared else 0.6, 9):
        places = move(grid(), share * SPACING_PX)
        beads = tracker.follow(draw(places))
        assert beads.found.all()
        assert np.linalg.norm(beads.position_px - places, axis=1).max() < 0.3
    assert tracker.counters.searches == 0


def test_hidden_beads_are_lost_and_come_back(skin):
    reference, draw = skin
    hidden = (0, 8, 24, 25)
    tracker = Tracker(reference)
    for shift, unseen in ((0.0, ()), (2.0, hidden), (4.0, hidden), (5.0, ())):
        places = grid() + np.array([shift, 0.0])
        beads = tracker.follow(draw(places, unseen))
        assert set(np.flatnonzero(~beads.found)) == set(unseen)
        assert np.linalg.norm(beads.position_px - places, axis=1).max() < 0.3 + 0.2 * bool(unseen)
    assert tracker.counters.beads_lost == 2 * len(hidden)
    assert tracker.counters.frames == 4


def test_a_speck_near_a_hidden_bead_is_no_bead(skin):
    """Dirt on the skin, a third as dark as a bead, may lie within reach of any hidden bead's place."""
    reference, draw = skin
    places, hidden = sheared(grid(), 0.7 * SPACING_PX), (16, 24)
    picture = draw(places, hidden).astype(np.float32)
    rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]]
    for bead in hidden:
        x, y = places[bead] + [0.28 * SPACING_PX, 0.0]
        picture -= 60 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 1.5**2))
    beads = Tracker(reference).follow(np.clip(picture, 0, 255).astype(np.uint8))
    assert beads.searched
    assert set(np.flatnonzero(~beads.found)) == set(hidden)


@pytest.mark.parametrize("hidden", [(24,), tuple(range(0, 49, 4)), tuple(range(14))])
def test_beads_that_stay_hidden_cause_one_search_at_most(skin, hidden):
    """One bead, 27 % of all here and there, or the first two rows: the others are followed as ever."""
    reference, draw = skin
    tracker = Tracker(reference)
    for shift in np.linspace(0.0, 6.0, 5):
        places = grid() + np.array([shift, 0.0])
        beads = tracker.follow(draw(places, hidden))
        assert set(np.flatnonzero(~beads.found)) == set(hidden)
    assert tracker.counters.searches <= 1


def test_after_a_jump_frames_are_searched_until_the_skin_stands_still(skin):
    """Single frames jump every time: windows about the last places would be read in vain."""
    reference, draw = skin
    tracker = Tracker(reference)
    searches = []
    for share in (0.0, 0.6, -0.6, 0.6, 0.6, 0.6):
        places = sheared(grid(), share * SPACING_PX)
        beads = tracker.follow(draw(places, hidden=(3, 20)))
        assert np.linalg.norm(beads.position_px - places, axis=1)[beads.found].max() < 0.3
        searches.append(tracker.counters.searches)
    assert np.diff(searches).tolist() == [1, 1, 1, 1, 0]


@pytest.mark.parametrize("share", [0.9, -0.9, 1.0])
def test_labels_a_row_off_stay_in_doubt_while_the_skin_stands_still(skin, share):
    """A jump by nearly a spacing gives labels a row off; only the border beads that are left over show it."""
    reference, draw = skin
    tracker = Tracker(reference)
    tracker.follow(draw(grid()))
    places = sheared(grid(), share * SPACING_PX)
    for seed in range(6):
        beads = tracker.follow(draw(places, seed=seed))
        error = np.linalg.norm(beads.position_px - places, axis=1)
        assert error[beads.found].max() > 0.5 * SPACING_PX
        assert beads.doubt > 0.03
    places = sheared(grid(), 0.4 * SPACING_PX)
    beads = tracker.follow(draw(places))
    assert beads.found.all()
    assert np.linalg.norm(beads.position_px - places, axis=1).max() < 0.3
    assert beads.doubt == 0.0


def test_labels_followed_without_a_jump_are_kept_through_doubt(skin):
    """Hidden beads beside specks as strong as beads are doubtful; the labels before were not."""
    reference, draw = skin
    tracker = Tracker(reference)
    for share in np.linspace(0, 0.8, 9):
        places = sheared(grid(), share * SPACING_PX)
        tracker.follow(draw(places))
    hidden = tuple(range(0, 49, 6))
    specks = places[list(hidden)] + 0.5 * SPACING_PX
    picture = draw(np.concatenate([places, specks]), hidden)
    doubts = []
    for _ in range(3):
        beads = tracker.follow(picture)
        assert np.linalg.norm(beads.position_px - places, axis=1)[beads.found].max() < 0.3
        doubts.append(beads.doubt)
    assert doubts[0] > 0.03
    assert doubts[1:] == [0.0, 0.0]
    assert tracker.counters.searches == 1


def test_light_touches_in_a_row_need_no_search(skin):
    """Each jumps from the one before, none far from the reference: windows about its places show them."""
    reference, draw = skin
    tracker = Tracker(reference)
    for way in (0.0, 40.0, 160.0, 280.0):
        aside = 0.2 * SPACING_PX * np.array([np.cos(np.radians(way)), np.sin(np.radians(way))])
        beads = tracker.follow(draw(grid() + aside))
        assert beads.found.all()
        assert np.linalg.norm(beads.position_px - grid() - aside, axis=1).max() < 0.3
    assert tracker.counters.searches == 0


def test_no_frame_is_searched_twice_and_no_bead_measured_often(skin):
    """Whatever a frame shows: a jump, another jump, specks and hidden beads, darkness."""
    reference, draw = skin
    tracker = Tracker(reference)
    searched, most = [], []
    frames = [draw(grid() + aside) for aside in ((0, 0), (9, 0), (-9, 5))]
    frames += [draw(bulged(grid(), 9.0), tuple(range(0, 49, 3))), np.full((256, 256), 20, np.float32)]
    for picture in [*frames, *reversed(frames)]:
        before, windows = tracker.counters.searches, tracker._windows.windows.copy()
        tracker.follow(picture)
        searched.append(tracker.counters.searches - before)
        measured = tracker._windows.windows - windows
        assert measured.max() <= 3 * 3  # at the last place, where the neighbours predict it, at its blob
        most.append(int(measured.max()))
    assert max(searched) == 1
    assert max(most) >= 1  # they are counted


def test_after_darkness_the_whole_image_is_searched_and_everything_found_again(skin):
    reference, draw = skin
    tracker = Tracker(reference)
    dark = np.full((256, 256), 20, dtype=np.float32)
    assert not tracker.follow(dark).found.any()
    places = grid() + np.array([6.0, -5.0])
    beads = tracker.follow(draw(places))
    assert beads.found.all()
    assert np.linalg.norm(beads.position_px - places, axis=1).max() < 0.3
    assert tracker.counters.searches >= 1


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sets(st.integers(0, 48), max_size=20))
def test_no_two_beads_sit_on_one_place(skin, seed, hidden):
    reference, draw = skin
    random = np.random.default_rng(seed)
    places = grid() + random.normal(0, 3, (49, 2))
    beads = Tracker(reference).follow(draw(places, tuple(hidden)))
    apart = distances(beads.position_px[beads.found], beads.position_px[beads.found])
    np.fill_diagonal(apart, np.inf)
    assert apart.size == 0 or apart.min() > 4.5


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    amount=st.floats(-0.45, 0.45),
    strangers=st.integers(0, 25),
    move=st.sampled_from([sheared, bulged]),
)
def test_assignment_never_swaps_and_is_one_to_one(seed, amount, strangers, move):
    random = np.random.default_rng(seed)
    moved = move(grid(), amount * SPACING_PX)
    order = random.permutation(len(moved))
    noise = random.uniform(0, 256, (strangers, 2))
    clear = distances(noise, moved).min(axis=1) > 0.6 * SPACING_PX if strangers else np.zeros(0, bool)
    candidates = np.concatenate([moved[order], noise[clear]])
    partner = assign(grid(), candidates, np.full(len(moved), SPACING_PX))
    chosen = partner[partner != NO_PARTNER]
    assert len(set(chosen)) == len(chosen)
    truth = np.argsort(order)
    given_away = partner != NO_PARTNER
    assert (partner[given_away] == truth[given_away]).all()
    assert given_away.mean() > 0.95


def test_assignment_of_small_motion_is_the_best_one_of_all():
    random = np.random.default_rng(3)
    candidates = (grid() + random.normal(0, 2.5, (49, 2)))[random.permutation(49)]
    best = linear_sum_assignment(distances(grid(), candidates) ** 2)[1]  # the Hungarian method
    assert assign(grid(), candidates, np.full(49, SPACING_PX)).tolist() == best.tolist()


def test_without_candidates_nobody_has_a_partner():
    assert set(assign(grid(), np.zeros((0, 2)), np.full(49, SPACING_PX))) == {NO_PARTNER}


def test_interpolating_a_constant_gives_that_constant():
    random = np.random.default_rng(2)
    known, wanted = random.uniform(0, 200, (30, 2)), random.uniform(-500, 500, (9, 2))
    value = np.tile([3.0, -4.0], (30, 1))
    assert np.allclose(interpolate(distances(wanted, known) / 12.0, value), [3.0, -4.0])


def test_labels_hold_from_one_touch_to_the_opposite_one(another_dome):
    """The skin moves from one side of the reference to the other between two frames.

    Every bead outside the last column then lies nearer to its neighbour's last place than to its own.
    """
    rest = grid(12)
    dome = another_dome(width=384, height=384, noise=1.5)
    count = len(rest)
    reference = Reference(rest, np.full(count, 9.0), np.full(count, 110.0), np.ones(count))

    def draw(places):
        return plane(dome.draw(places, np.full(count, 9.0), 1, ()), Appearance())

    tracker = Tracker(reference)
    aside = np.array([0.4 * SPACING_PX, 0.0])
    tracker.follow(draw(rest + aside))
    beads = tracker.follow(draw(rest - aside))
    error = np.linalg.norm(beads.position_px - (rest - aside), axis=1)
    assert (error[beads.found] < 0.3).all()
    assert beads.found.mean() > 0.95


def dimmed(picture, places, share):
    """Beads at `places` with that share of their contrast to the skin beside them."""
    rows, columns = np.mgrid[: picture.shape[0], : picture.shape[1]]
    picture = picture.astype(np.float32)
    for x, y in places:
        beside = picture[round(y), round(x + 0.5 * SPACING_PX)]
        near = np.hypot(columns - x, rows - y) < 0.45 * SPACING_PX
        picture[near] = beside + share * (picture[near] - beside)
    return picture


def test_beads_in_dim_light_are_found_and_known_to_be_less_exact(skin):
    reference, draw = skin
    dim = [17, 24, 25, 31]
    picture = dimmed(draw(grid()), grid()[dim], 0.28)
    beads = Tracker(reference).follow(picture)
    assert beads.found.all()
    assert beads.noise is not None
    exact = np.setdiff1d(np.arange(49), dim)
    assert (beads.noise[dim] > 2.0).all()
    assert (beads.noise[exact] == 1.0).all()
    assert np.linalg.norm(beads.position_px - grid(), axis=1).max() < 0.6


def test_in_the_reference_frames_light_all_beads_are_exact(skin):
    reference, draw = skin
    beads = Tracker(reference).follow(draw(grid()))
    assert beads.noise is None
    assert beads.all_exact
    assert (beads.weight == 1.0).all()


@pytest.mark.parametrize("seed", range(8))
def test_beads_at_the_edge_of_a_glare_patch_are_lost_and_not_displaced(skin, seed):
    """A lamp's reflection that saturates in its middle: its edge draws a centroid away by up to 3 px."""
    reference, draw = skin
    x, y = np.random.default_rng(seed).uniform(80, 170, 2)
    rows, columns = np.mgrid[:256, :256]
    spot = np.clip(1.5 * np.exp(-np.log(3.0) * ((columns - x) ** 2 + (rows - y) ** 2) / 30**2), 0, 1)
    clean = draw(grid())
    even = replace(reference, unevenness=np.full(len(grid()), 0.03))
    beads = Tracker(even).follow((clean + (255.0 - clean) * spot).astype(np.uint8))
    error = np.linalg.norm(beads.position_px - grid(), axis=1)
    assert (error[beads.found] < 1.0).all()
    assert beads.found.mean() > 0.7
