"""Growth of a hexagonal lattice over spots of a picture: which spot is at which place of the lattice.

From a spot with regular neighbours near the middle on, each place next to occupied ones is predicted from
those around it, and takes the spot that is there. A lens, a dome and a press bend the lattice little from
place to place. Spots that are none of its own, as reflections are, fit no place of the hexagon; places
without a spot are predicted as well.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.geometry.hexagonal_lattice import STEPS, lattice_distance
from palpate_edge.geometry.picture_sensor import hexagonal_counts
from palpate_edge.geometry.points import distances, spacing

NO_SPOT = -1
SPOTS_PER_MARKER = 1.36
WEAKEST_SHARE = 0.25  # of the markers' median strength
AROUND = 6
# From a predicted place to its spot, over the shortest step there; and the same for the last places of the
# hexagon: its corners are bent most.
TOLERANCE, LAST_TOLERANCE = 0.5, 0.6
LEAST_STEP_PX = 1e-3
STARTS = 6
START_STEPS = 3  # from the middle of all spots, within which the lattice starts
MOST_OFF_MIDDLE = 3  # steps, from the mean of the occupied places to the middle of the hexagon

Site = tuple[int, int]


class HexagonSpots(NamedTuple):
    """Places (m, 2) of the m = 1 + 3 k (k + 1) markers of a hexagon, and the spot (m,) of each or NO_SPOT.

    A place without a spot is where the markers around it predict one.
    """

    position_px: Array
    spot: Indices

    @property
    def seen(self) -> int:
        """The number of markers with a spot."""
        return int((self.spot != NO_SPOT).sum())


class Prediction(NamedTuple):
    """place_px (2,) of a site; step_px: the shortest step of the lattice there."""

    place_px: Array
    step_px: float


def hexagon_spots(spot_px: Array, strength: Array, count: int) -> HexagonSpots | None:
    """Return the hexagon of `count` markers that holds most of the spots (n, 2).

    None without a lattice, and for a count that fills no hexagon.

    strength (n,): the spots', the strongest first. Weak ones and those beyond `SPOTS_PER_MARKER` are left
    out: they lie anywhere.
    """
    counts = hexagonal_counts(count)
    strong = strength > WEAKEST_SHARE * np.median(strength[:count]) if len(strength) else strength
    spot_px = spot_px[: min(round(SPOTS_PER_MARKER * count), np.count_nonzero(strong))]
    if counts[-1] != count or len(spot_px) <= AROUND:
        return None
    shells, best = len(counts) - 1, None
    for start in _starts(spot_px):
        found = _filled(_grown(start, spot_px, shells + START_STEPS), spot_px, shells)
        if found is not None and (best is None or found.seen > best.seen):
            best = found
        if best is not None and best.seen == count:
            break
    return best


def _filled(occupied: dict[Site, int], spot_px: Array, shells: int) -> HexagonSpots | None:
    """Return the hexagon that holds most of the occupied places, its empty ones filled by prediction."""
    sites = _hexagon(occupied, shells)
    inside = {site: occupied[site] for site in sites if site in occupied}
    places = {site: spot_px[spot] for site, spot in inside.items()}
    last = {site: _predicted(site, places) for site in sites if site not in inside}
    inside |= _fitting(last, spot_px, set(inside.values()), LAST_TOLERANCE)
    places |= {site: spot_px[spot] for site, spot in inside.items()}
    empty = [site for site in sites if site not in inside]
    while empty:
        predicted = {site: _predicted(site, places) for site in empty}
        filled = {site: found.place_px for site, found in predicted.items() if found is not None}
        if not filled:
            return None
        places |= filled
        empty = [site for site in empty if site not in filled]
    spot = np.array([inside.get(site, NO_SPOT) for site in sites])
    return HexagonSpots(np.array([places[site] for site in sites]), spot)


def _grown(start: dict[Site, int], spot_px: Array, most_steps: int) -> dict[Site, int]:
    """Return the spot at each occupied place of the lattice, in coordinates about the first one.

    It grows step by step away from there: a part that runs ahead of the others goes astray.
    """
    occupied = dict(start)
    places = {site: spot_px[spot] for site, spot in occupied.items()}
    for steps in range(1, most_steps + 1):
        while True:
            near = [site for site in _beside(occupied) if lattice_distance(np.array([site])) <= steps]
            predicted = {site: _predicted(site, places) for site in near}
            taken = _fitting(predicted, spot_px, set(occupied.values()), TOLERANCE)
            if not taken:
                break
            occupied |= taken
            places |= {site: spot_px[spot] for site, spot in taken.items()}
    return occupied


def _fitting(
    predicted: dict[Site, Prediction | None], spot_px: Array, used: set[int], tolerance: float
) -> dict[Site, int]:
    """Return the nearest spot of each predicted place that has one within the tolerance and not `used`; of
    several places that would have the same spot only the nearest gets it."""
    free = np.ones(len(spot_px), dtype=np.bool_)
    free[list(used)] = False
    fitting: list[tuple[float, Site, int]] = []
    for site, prediction in predicted.items():
        if prediction is None or not free.any():
            continue
        off = np.linalg.norm(spot_px - prediction.place_px, axis=1) / prediction.step_px
        off[~free] = np.inf
        fitting.append((float(off.min()), site, int(off.argmin())))
    found: dict[Site, int] = {}
    for off_steps, site, spot in sorted(fitting):
        if off_steps < tolerance and free[spot]:
            free[spot], found[site] = False, spot
    return found


def _beside(occupied: dict[Site, int]) -> set[Site]:
    """Return the places one step from an occupied one that are not occupied."""
    return {(i + di, j + dj) for i, j in occupied for di, dj in STEPS.tolist()} - occupied.keys()


def _starts(spot_px: Array) -> Iterator[dict[Site, int]]:
    """Yield spots near the middle, each at the origin with its six neighbours, the most regular first."""
    apart = distances(spot_px, spot_px)
    np.fill_diagonal(apart, np.inf)
    around = np.argsort(apart, axis=1, kind="stable")[:, :AROUND]
    way = (spot_px[around] - spot_px[:, None]) @ [1, 1j]
    in_turn = np.argsort(np.angle(way), axis=1)
    way = np.take_along_axis(way, in_turn, axis=1)
    # In a regular hexagon each way is the sum of those beside it.
    beside = np.roll(way, 1, axis=1) + np.roll(way, -1, axis=1)
    irregular = np.abs(beside - way).max(axis=1) / np.maximum(np.abs(way).mean(axis=1), LEAST_STEP_PX)
    off_middle = np.linalg.norm(spot_px - np.median(spot_px, axis=0), axis=1)
    irregular[off_middle > max(START_STEPS * np.median(spacing(spot_px)), off_middle.min())] = np.inf
    for first in np.argsort(irregular, kind="stable")[:STARTS].tolist():
        neighbours = around[first][in_turn[first]].tolist()
        yield {(0, 0): first} | {(i, j): at for (i, j), at in zip(STEPS.tolist(), neighbours, strict=True)}


def _predicted(site: Site, places: dict[Site, Array]) -> Prediction | None:
    """Return what the places around predict of a site; None where they predict nothing.

    Straight lines go on, rhombs are completed, and a place lies midway between opposite ones. The median of
    all these is of the side on which the lattice is bent less.
    """

    def at(*steps: Indices) -> Array | None:
        i, j = np.array(site) + sum(steps)
        return places.get((int(i), int(j)))

    guesses, apart_px = [], []
    for step, following in zip(STEPS, np.roll(STEPS, -1, axis=0), strict=True):
        beside = at(step)
        if beside is None:
            continue
        apart_px.append(beside)
        if (behind := at(2 * step)) is not None:
            guesses.append(2 * beside - behind)
        if (opposite := at(-step)) is not None:
            guesses.append((beside + opposite) / 2)
        other, far = at(following), at(step, following)
        if other is not None and far is not None:
            guesses.append(beside + other - far)
    if not guesses:
        return None
    place_px = np.median(guesses, axis=0)
    step_px = float(np.linalg.norm(apart_px - place_px, axis=1).min())
    return Prediction(place_px, max(step_px, LEAST_STEP_PX))


def _hexagon(occupied: dict[Site, int], shells: int) -> list[Site]:
    """Return the places of the hexagon of so many shells that holds most of the occupied ones."""
    place = np.array(list(occupied))
    mean = np.rint(place.mean(axis=0)).astype(np.intp)
    near = range(-MOST_OFF_MIDDLE, MOST_OFF_MIDDLE + 1)
    middles = [mean + np.array([i, j]) for i in near for j in near]
    held = [int((lattice_distance(place - middle) <= shells).sum()) for middle in middles]
    middle = middles[int(np.argmax(held))]
    every = range(-shells, shells + 1)
    inside = [(i, j) for i in every for j in every if abs(i + j) <= shells]
    return [(int(middle[0]) + i, int(middle[1]) + j) for i, j in inside]
