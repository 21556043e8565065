"""Lines of coloured text, and the cells of a terminal that show one: 24-bit or 256 colours, or plain ASCII.
Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from enum import Enum
from functools import lru_cache
from typing import NamedTuple
from unicodedata import combining, east_asian_width

Rgb = tuple[int, int, int]
"""Red, green and blue, each 0 to 255."""

RESET = "\x1b[0m"
DEFAULT_STYLE = "\x1b[39m", "\x1b[49m"
CUBE_LEVELS = (0, 95, 135, 175, 215, 255)  # of xterm's 256 colours: 16 + 36 red + 6 green + blue
ASCII_FORMS = str.maketrans({"–": "-", "±": "~", "°": " ", "·": ".", "→": ">", "█": "#"})

RED, GREEN, YELLOW, ORANGE, GREY = (
    (255, 107, 107),
    (80, 220, 60),
    (255, 220, 0),
    (255, 157, 77),
    (150, 150, 150),
)


class Palette(Enum):
    """Colours of a terminal. NONE: no colour, and ASCII only."""

    NONE = "none"
    INDEXED = "256"
    TRUE = "24 bit"


class Span(NamedTuple):
    """Text of one colour; None: the terminal's own."""

    text: str
    colour: Rgb | None = None
    ground: Rgb | None = None


Line = list[Span]

Cell = tuple[str, str, str]
"""A character, and the sequences that select the colours of text and ground."""
BLANK: Cell = (" ", *DEFAULT_STYLE)


def palette_of(environment: Mapping[str, str]) -> Palette:
    """Return the palette of a terminal from TERM, COLORTERM, the locale and NO_COLOR (no-color.org)."""
    locale = environment.get("LC_ALL") or environment.get("LC_CTYPE") or environment.get("LANG") or ""
    is_utf8 = locale.lower().replace("-", "").endswith("utf8")
    if environment.get("NO_COLOR") or not is_utf8:
        return Palette.NONE
    if environment.get("COLORTERM") in ("truecolor", "24bit"):
        return Palette.TRUE
    return Palette.INDEXED if "256" in environment.get("TERM", "") else Palette.NONE


def text_line(text: str, colour: Rgb | None = None) -> Line:
    """Return a line of one colour."""
    return [Span(text, colour)]


def number_text(value: float | None, digits: int, unit: str) -> str:
    """Return a value with its unit; a dash for an unknown one."""
    return "–" if value is None else f"{value:.{digits}f} {unit}"


def beside(left: list[Line], width: int, right: list[Line]) -> list[Line]:
    """Return lines with `right` beside `left`, which is cut or filled to `width` columns."""
    rows = max(len(left), len(right))
    padded = [lines + [[] for _ in range(rows - len(lines))] for lines in (left, right)]
    return [[*cut(one, width, fill=True), *other] for one, other in zip(*padded, strict=True)]


def cut(line: Iterable[Span], width: int, *, fill: bool = False) -> Line:
    """Return the first `width` columns; fill: with spaces to that width."""
    kept, left = [], width
    for span in line:
        is_whole = len(span.text) <= left
        kept.append(span if is_whole else Span(span.text[:left], span.colour, span.ground))
        left -= min(left, len(span.text))
    return [*kept, Span(" " * left)] if fill and left > 0 else kept


def cells(line: Line, width: int, palette: Palette) -> list[Cell]:
    """Return the `width` cells that show a line.

    Control characters, which text from elsewhere may contain, and characters that do not take exactly one
    cell become question marks.
    """
    shown: list[Cell] = []
    style, is_true = DEFAULT_STYLE, palette is Palette.TRUE
    for text, colour, ground in line:
        if palette is not Palette.NONE:
            style = _text_style(colour, is_true), _ground_style(ground, is_true)
        shown += [(one, *style) for one in _characters(text, palette is Palette.NONE)]
    return shown[:width] + [BLANK] * (width - len(shown))


def redrawn(rows: Sequence[Sequence[Cell]], former: Sequence[Sequence[Cell]]) -> str:
    """Return what a terminal that shows `former` is sent to show `rows`, of the same size: only changed
    cells."""
    parts: list[str] = []
    style = DEFAULT_STYLE
    for row, (new, old) in enumerate(zip(rows, former, strict=True), start=1):
        if new == old:
            continue
        drawn_to = -1
        for column, cell in enumerate(new):
            if cell == old[column]:
                continue
            if column != drawn_to:
                parts.append(f"\x1b[{row};{column + 1}H")
            parts += [part for part, last in zip(cell[1:], style, strict=True) if part != last]
            parts.append(cell[0])
            style, drawn_to = cell[1:], column + 1
    return "".join(parts) + ("" if style == DEFAULT_STYLE else RESET)


def plain_text(line: Line) -> str:
    """Return the text of a line."""
    return "".join(span.text for span in line)


@lru_cache(maxsize=1 << 12)
def _characters(text: str, is_ascii: bool) -> str:
    """Return what is shown of a text, one character a cell."""
    text = "".join(one if _takes_a_cell(one) else "?" for one in text)
    return text.translate(ASCII_FORMS).encode("ascii", "replace").decode() if is_ascii else text


def _takes_a_cell(character: str) -> bool:
    return character.isprintable() and not combining(character) and east_asian_width(character) not in "WF"


@lru_cache(maxsize=1 << 14)
def _text_style(colour: Rgb | None, is_true: bool) -> str:
    """Return the SGR sequence (ECMA-48) of a colour of text. is_true: of 24 bits, else of 256 colours."""
    return DEFAULT_STYLE[0] if colour is None else f"\x1b[38;{_number(colour, is_true)}m"


@lru_cache(maxsize=1 << 14)
def _ground_style(colour: Rgb | None, is_true: bool) -> str:
    """Return the SGR sequence of a colour of the ground."""
    return DEFAULT_STYLE[1] if colour is None else f"\x1b[48;{_number(colour, is_true)}m"


def _number(colour: Rgb, is_true: bool) -> str:
    return "2;{};{};{}".format(*colour) if is_true else f"5;{indexed(colour)}"


def indexed(colour: Rgb) -> int:
    """Return the nearest of xterm's 256 colours, 16 to 255: of its cube, or of its 24 greys."""
    cube = [min(range(6), key=lambda step: abs(CUBE_LEVELS[step] - value)) for value in colour]
    grey = min(23, max(0, round((sum(colour) / 3 - 8) / 10)))

    def distance(other: Iterable[int]) -> int:
        return sum((one - two) ** 2 for one, two in zip(colour, other, strict=True))

    if distance([8 + 10 * grey] * 3) < distance(CUBE_LEVELS[step] for step in cube):
        return 232 + grey
    return 16 + 36 * cube[0] + 6 * cube[1] + cube[2]
