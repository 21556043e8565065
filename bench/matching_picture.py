"""Draw how blobs become numbered beads: docs/matching.png, the four steps of correspondence.py on 331 pins.

python -m bench.matching_picture

The pins are displaced by up to 1.1 spacings, so the nearest blob is often the neighbour's.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from palpate_edge.common.arrays import Array, Indices
from palpate_edge.kernels.nearest_blob import NO_BLOB, BlobGrid
from palpate_edge.vision.blob_detection import Blobs
from palpate_edge.vision.correspondence import START_GATE, Correspondence, Match
from palpate_edge.vision.neighbourhood import Neighbourhood

PICTURE = Path(__file__).parents[1] / "docs" / "matching.png"
SPACING_PX, SHELLS = 17.0, 10
CENTRE_PX = np.array([320.0, 240.0])
DENT_SPACINGS, DENT_WIDTH, DENT_AT_PX = 1.1, 4.0, (350.0, 220.0)
RIGHT, WRONG, REST, BLOB = "#2a7f4f", "#c0392b", "#b8b8b8", "#20303c"
PATCHES = ("#2a7f4f", "#d08a1d", "#7a5ba6", "#3a7ca5")


def lattice() -> Array:
    """Return the pins (331, 2) at rest: a hexagon of ten shells, in pixels."""
    numbers = range(-SHELLS, SHELLS + 1)
    pairs = [(q + 0.5 * r, np.sqrt(0.75) * r) for q in numbers for r in numbers if abs(q + r) <= SHELLS]
    return CENTRE_PX + SPACING_PX * np.array(pairs)


def dent(rest_px: Array) -> Array:
    """Return the pins displaced by a Gaussian dent."""
    squared = ((rest_px - DENT_AT_PX) ** 2).sum(axis=1) / (DENT_WIDTH * SPACING_PX) ** 2
    away = DENT_SPACINGS * SPACING_PX * np.exp(-0.5 * squared)[:, None]
    return np.asarray(rest_px + away * np.array([0.9, 0.4]))


def labels(axes: Axes, rest_px: Array, place_px: Array, blob: Indices) -> None:
    """Draw a line from each labelled pin at rest to its blob, red where the blob is another pin's."""
    known = np.flatnonzero(blob != NO_BLOB)
    lines = np.stack([rest_px[known], place_px[blob[known]]], axis=1)
    axes.add_collection(
        LineCollection(list(lines), colors=[RIGHT if blob[bead] == bead else WRONG for bead in known])
    )


def draw(rest_px: Array, place_px: Array) -> Figure:
    """Return the figure of the four steps; blob i of the image is pin i."""
    blobs = Blobs(place_px, np.full(len(place_px), 40.0))
    correspondence = Correspondence(Neighbourhood(rest_px))
    grid = BlobGrid()
    grid.load(place_px)
    nearest = grid.assign(rest_px, np.full(len(rest_px), (START_GATE * SPACING_PX) ** 2))
    match = correspondence.match(blobs, rest_px[None])
    row_off = correspondence.match(Blobs(rest_px, blobs.strength), rest_px[None] + (SPACING_PX, 0.0))
    figure = Figure(figsize=(11, 10.5), layout="constrained")
    first, second, third, fourth = np.ravel(figure.subplots(2, 2))
    wrong = np.count_nonzero((nearest != NO_BLOB) & (nearest != np.arange(len(nearest))))
    first.set_title(f"1. Nearest blob within half a spacing: {wrong} labels are wrong")
    labels(first, rest_px, place_px, nearest)
    second.set_title("2. Patches that move alike; the largest is the seed")
    patches = correspondence.patches(place_px[nearest] - rest_px, nearest != NO_BLOB)
    for colour, patch in zip(PATCHES, patches, strict=False):
        second.plot(*rest_px[patch].T, "o", ms=7, color=colour)
    third.set_title(f"3. Grown from the seed: {_wrong(match)} wrong, doubt {100 * match.doubt:.0f} %")
    labels(third, rest_px, place_px, match.blob)
    fourth.set_title(
        f"4. Check: labels a row off leave beads and blobs over, doubt {100 * row_off.doubt:.0f} %"
    )
    labels(fourth, rest_px, rest_px, row_off.blob)
    spare = np.setdiff1d(np.arange(len(rest_px)), row_off.blob)
    fourth.plot(*rest_px[spare].T, "s", ms=8, mfc="none", color=WRONG, label="blob without bead")
    fourth.plot(*row_off.predicted_px[~row_off.found].T, "x", color=WRONG, label="bead without blob")
    figure.legend(*fourth.get_legend_handles_labels(), loc="outside lower center", ncols=2)
    for axes, shown in ((first, place_px), (second, place_px), (third, place_px), (fourth, rest_px)):
        axes.plot(*rest_px.T, ".", ms=3, color=REST, zorder=0)
        axes.plot(*shown.T, "o", ms=3, mfc="none", color=BLOB, zorder=1)
        axes.set_aspect("equal")
        axes.invert_yaxis()
        axes.set_axis_off()
    return figure


def _wrong(match: Match) -> int:
    return int(np.count_nonzero(match.found & (match.blob != np.arange(len(match.blob)))))


def main() -> None:
    rest_px = lattice()
    draw(rest_px, dent(rest_px)).savefig(PICTURE, dpi=100)
    print(f"wrote {PICTURE.name}")


if __name__ == "__main__":
    main()
