"""The picture in characters."""

from __future__ import annotations

import numpy as np
import pytest

from palpate_edge.common.terminal.lines import GREEN, RED, YELLOW, Palette, plain_text
from palpate_edge.console.terminal.picture_cells import picture_lines, picture_size
from palpate_edge.daemon.watching.watch_messages import BeadsShown


@pytest.mark.parametrize(
    ("size_px", "space", "cells"),
    [
        ((640, 480), (43, 14), (37, 14)),
        ((640, 480), (20, 14), (20, 8)),
        ((480, 640), (80, 20), (30, 20)),
        ((1000, 10), (40, 5), (40, 1)),
    ],
)
def test_a_picture_keeps_its_proportions(size_px, space, cells):
    assert picture_size(size_px, *space) == cells


def test_a_cell_has_two_pixels():
    image = np.zeros((4, 3, 3), np.uint8)
    image[1, 2] = (16, 24, 33)  # BGR
    lines = picture_lines(image, None, (3, 4), (3, 2), Palette.INDEXED)
    assert [plain_text(line) for line in lines] == ["▀▀▀"] * 2
    assert (lines[0][2].colour, lines[0][2].ground) == ((0, 0, 0), (32, 24, 16))
    grey = picture_lines(image[:, :, 2], None, (3, 4), (3, 2), Palette.INDEXED)
    assert grey[0][2].ground == (32, 32, 32)


def test_shades_without_colours():
    image = np.array([[0, 100], [200, 255]], np.uint8)
    lines = picture_lines(image, None, (2, 2), (2, 2), Palette.NONE)
    assert [plain_text(line) for line in lines] == [" -", "%@"]


def test_beads_are_marked_where_they_are():
    image = np.zeros((480, 640), np.uint8)
    beads = BeadsShown(
        [(0, 0), (320, 240), (639, 479), (700, 0)], [(0, 1), (310, 240), (639, 479), (700, 0)], [2]
    )
    ascii_lines = picture_lines(image, beads, (640, 480), (4, 3), Palette.NONE)
    assert [plain_text(line) for line in ascii_lines] == ["o   ", "  O ", "   x"]
    lines = picture_lines(image, beads, (640, 480), (4, 3), Palette.TRUE)
    assert lines[0][0].colour == GREEN
    assert lines[1][2].ground == YELLOW
    assert lines[2][3].ground == RED
