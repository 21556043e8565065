"""A camera's picture with its beads, as characters of a terminal. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.terminal.lines import GREEN, RED, YELLOW, Line, Palette, Rgb, Span
from palpate_edge.daemon.watching.watch_messages import BeadsShown

SHADES = " .:-=+*%@"
MOVED_SHARE = 1.2 / 640
"""A bead displaced by more than this share of the picture's width is marked as moved, as on the page."""
MARKS: dict[Rgb, str] = {GREEN: "o", YELLOW: "O", RED: "x"}
UPPER_HALF = "▀"
COLOUR_STEP = 8
"""Colours are rounded down to multiples of this, so that noise does not change most cells of each picture."""

Marks = dict[tuple[int, int], Rgb]
"""Column and row of a pixel and the colour that replaces it."""


def picture_size(size_px: tuple[int, int], columns: int, rows: int) -> tuple[int, int]:
    """Return columns and rows of a picture that fits, its sides in proportion: a cell is twice as high as
    wide."""
    width, height = size_px
    fitting = min(columns, 2 * rows * width // height)
    return max(1, fitting), max(1, min(rows, round(fitting * height / width / 2)))


def picture_lines(
    image: Image, beads: BeadsShown | None, size_px: tuple[int, int], cells: tuple[int, int], palette: Palette
) -> list[Line]:
    """Return the lines of a picture of `cells`, columns and rows.

    image: (height, width) or (height, width, 3), BGR. size_px: width and height that `beads` refer to. Beads
    are green (o), moved ones yellow (O), lost ones red (x). With colours a cell has two pixels, else one.
    """
    columns, rows = cells
    pixel_rows = rows if palette is Palette.NONE else 2 * rows
    small = np.asarray(cv2.resize(image, (columns, pixel_rows), interpolation=cv2.INTER_AREA))
    marks = dict(_marks(beads, size_px, (columns, pixel_rows))) if beads is not None else {}
    if palette is Palette.NONE:
        grey = small if small.ndim == 2 else small.mean(axis=2)
        shades = (grey.astype(float) / 256 * len(SHADES)).astype(int)
        return [_ascii_row(shades[row].tolist(), row, marks) for row in range(rows)]
    small = small // COLOUR_STEP * COLOUR_STEP
    colours = np.repeat(small[:, :, None], 3, axis=2) if small.ndim == 2 else small[:, :, ::-1]
    pixels = [[tuple(pixel) for pixel in row] for row in colours.tolist()]
    for (column, row), colour in marks.items():
        pixels[row][column] = colour
    return [
        [Span(UPPER_HALF, *pair) for pair in zip(pixels[row], pixels[row + 1], strict=True)]
        for row in range(0, pixel_rows, 2)
    ]


def _ascii_row(shades: list[int], row: int, marks: Marks) -> Line:
    cells = [
        MARKS[marks[column, row]] if (column, row) in marks else SHADES[shade]
        for column, shade in enumerate(shades)
    ]
    return [Span("".join(cells))]


def _marks(
    beads: BeadsShown, size_px: tuple[int, int], pixels: tuple[int, int]
) -> Iterator[tuple[tuple[int, int], Rgb]]:
    """Yield the pixel of each bead and its colour; lost beads, at their last place, come last."""
    width, height = size_px
    lost = set(beads.lost)
    by_loss = sorted(range(len(beads.position_px)), key=lost.__contains__)
    for bead in by_loss:
        (x, y), rest = beads.position_px[bead], beads.rest_px[bead]
        column, row = int((x + 0.5) * pixels[0] / width), int((y + 0.5) * pixels[1] / height)
        if 0 <= column < pixels[0] and 0 <= row < pixels[1]:
            is_moved = math.dist((x, y), rest) > MOVED_SHARE * width
            yield (column, row), RED if bead in lost else YELLOW if is_moved else GREEN
