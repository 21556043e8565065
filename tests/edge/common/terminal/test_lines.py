"""Coloured lines: palettes, cuts, and what a terminal is sent."""

from __future__ import annotations

import pytest

from palpate_edge.common.terminal.lines import (
    BLANK,
    Palette,
    Span,
    beside,
    cells,
    indexed,
    palette_of,
    plain_text,
    redrawn,
)

XTERM = {"TERM": "xterm-256color", "LANG": "en_US.UTF-8"}


@pytest.mark.parametrize(
    ("environment", "palette"),
    [
        (XTERM, Palette.INDEXED),
        ({**XTERM, "COLORTERM": "truecolor"}, Palette.TRUE),
        ({**XTERM, "COLORTERM": "truecolor", "NO_COLOR": "1"}, Palette.NONE),
        ({**XTERM, "LC_ALL": "C"}, Palette.NONE),
        ({**XTERM, "LANG": "de_DE.utf8"}, Palette.INDEXED),
        ({"TERM": "vt100", "LANG": "C.UTF-8"}, Palette.NONE),
        ({}, Palette.NONE),
    ],
)
def test_the_palette_follows_the_environment(environment, palette):
    assert palette_of(environment) is palette


@pytest.mark.parametrize(
    ("colour", "index"),
    [  # of xterm's 256colres.h
        ((0, 0, 0), 16),
        ((255, 0, 0), 196),
        ((95, 135, 175), 67),
        ((8, 8, 8), 232),
        ((238, 238, 238), 255),
        ((255, 255, 255), 231),
        ((128, 128, 128), 244),
    ],
)
def test_colours_of_xterm(colour, index):
    assert indexed(colour) == index


def drawn(line, width, palette):
    """Return the bytes that an empty terminal of one row receives."""
    return redrawn([cells(line, width, palette)], [[BLANK] * width])


def plain(line, palette):
    return "".join(character for character, _, _ in cells(line, 80, palette)).rstrip()


def test_a_line_is_cut_coloured_and_reset():
    line = [Span("ab", (255, 0, 0)), Span("cd", (255, 0, 0), (8, 8, 8)), Span("ef")]
    assert drawn(line, 5, Palette.TRUE) == (
        "\x1b[1;1H\x1b[38;2;255;0;0mab\x1b[48;2;8;8;8mcd\x1b[39m\x1b[49me"
    )
    assert drawn(line[:1], 9, Palette.INDEXED) == "\x1b[1;1H\x1b[38;5;196mab\x1b[0m"
    assert drawn(line, 3, Palette.NONE) == "\x1b[1;1Habc"


def test_only_changed_cells_are_sent():
    def rows(*texts):
        return [cells([Span(text, (255, 0, 0))], 8, Palette.INDEXED) for text in texts]

    former = rows("contact", "force 1", "same")
    assert redrawn(former, former) == ""
    sent = redrawn(rows("contact", "farce 23", "same"), former)
    assert sent == "\x1b[2;2H\x1b[38;5;196ma\x1b[2;7H23\x1b[0m"
    assert redrawn(rows("contact", "force", "same"), former) == "\x1b[2;6H  "


def test_text_from_elsewhere_cannot_steer_the_terminal():
    line = [Span("a\x1b[2Jb\n\x9bc°±")]
    assert plain(line, Palette.INDEXED) == "a?[2Jb??c°±"
    assert plain(line, Palette.NONE) == "a?[2Jb??c ~"


def test_a_character_of_two_cells_or_none_is_replaced():
    """Otherwise the cells after it would not be where they are counted."""
    assert (
        plain([Span("a\N{CJK UNIFIED IDEOGRAPH-624B}\N{COMBINING ACUTE ACCENT}e\u00e9▀")], Palette.TRUE)
        == "a??eé▀"
    )


def test_columns_side_by_side_are_cut_and_filled():
    lines = beside([[Span("picture")], [Span("p")]], 4, [[Span("1")], [Span("2")], [Span("3")]])
    assert [plain_text(line) for line in lines] == ["pict1", "p   2", "    3"]
