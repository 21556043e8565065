"""The dome from above with the contact, as characters. Pure."""

from __future__ import annotations

import math

from palpate_edge.common.contact import Contact
from palpate_edge.common.terminal.lines import GREY, ORANGE, RED, Line, Span

CONTACT, RADIUS, SKIN = "@", "+", "."


def dome_lines(contact: Contact | None, outer_radius_mm: float, rows: int) -> list[Line]:
    """Return `rows` lines of 2 `rows` columns in frame F: x to the right, y up.

    The contact is an @, red when it slips, with a + where its 95 % radius reaches.
    """
    step_mm = 2 * outer_radius_mm / rows
    cells = [
        [_skin(column, row, rows, step_mm, outer_radius_mm) for column in range(2 * rows)]
        for row in range(rows)
    ]
    if contact is None or not contact.valid or contact.position_mm is None:
        return cells
    x_mm, y_mm, _ = contact.position_mm
    for row, line in enumerate(cells):
        for column in range(2 * rows):
            right_mm, up_mm = _middle(column, row, rows, step_mm)
            if math.hypot(right_mm - x_mm, up_mm - y_mm) <= (contact.radius95_mm or 0.0):
                line[column] = Span(RADIUS, ORANGE)
    column, row = math.floor(2 * x_mm / step_mm) + rows, math.floor(rows / 2 - y_mm / step_mm)
    if 0 <= column < 2 * rows and 0 <= row < rows:
        cells[row][column] = Span(CONTACT, RED if contact.slip else ORANGE)
    return cells


def _skin(column: int, row: int, rows: int, step_mm: float, outer_radius_mm: float) -> Span:
    is_skin = math.hypot(*_middle(column, row, rows, step_mm)) <= outer_radius_mm
    return Span(SKIN if is_skin else " ", GREY)


def _middle(column: int, row: int, rows: int, step_mm: float) -> tuple[float, float]:
    """Return x and y of a cell's middle in mm; a cell is half a step wide and a step high."""
    return (column + 0.5 - rows) * step_mm / 2, (rows / 2 - row - 0.5) * step_mm
