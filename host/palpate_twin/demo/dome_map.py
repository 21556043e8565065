"""A text map of the dome seen from above: base edge, circles at 30 and 60 degrees, the contact as a dot.

It is drawn with Unicode braille patterns (U+2800: 2 x 4 dots per character, bits numbered as in the Unicode
chart).
"""

from __future__ import annotations

import math

from rich.text import Text

_DOT_BITS = ((0x01, 0x02, 0x04, 0x40), (0x08, 0x10, 0x20, 0x80))  # column, then row
_CIRCLES = ((90.0, 1), (60.0, 3), (30.0, 3))  # angle from the pole in deg, spacing in dots
CONTACT_DOT = "●"


def dome_map(
    width: int, height: int, radius_mm: float, position_mm: tuple[float, float, float] | None
) -> Text:
    """Return a map of `height` lines of `width` characters, with x of frame F to the right and y up.

    radius_mm: radius of the dome's outer sphere. position_mm: contact position on it, None without contact.
    """
    columns, rows = 2 * width, 4 * height
    radius_dots = (min(columns, rows) - 1) / 2
    cells = [[0] * width for _ in range(height)]
    for angle_deg, spacing in _CIRCLES:
        size = radius_dots * math.sin(math.radians(angle_deg))
        count = max(8, round(math.tau * size / spacing))
        for step in range(count):
            turn = math.tau * step / count
            column = round((columns - 1) / 2 + size * math.cos(turn))
            row = round((rows - 1) / 2 - size * math.sin(turn))
            cells[row // 4][column // 2] |= _DOT_BITS[column % 2][row % 4]
    lines = ["".join(chr(0x2800 + bits) for bits in line) for line in cells]
    text = Text("\n".join(lines), style="bright_black", no_wrap=True)
    if position_mm is None:
        return text
    scale = radius_dots / radius_mm
    column = _clamp(int((columns / 2 + scale * position_mm[0]) / 2), width)
    row = _clamp(int((rows / 2 - scale * position_mm[1]) / 4), height)
    start = row * (width + 1) + column
    return Text.assemble(text[:start], (CONTACT_DOT, "bold bright_red"), text[start + 1 :])


def _clamp(index: int, count: int) -> int:
    return max(0, min(count - 1, index))
