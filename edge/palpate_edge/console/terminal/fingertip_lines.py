"""The screen of a fingertip: lines from what is known of it, for any size of a terminal. Pure."""

from __future__ import annotations

import math
import textwrap

from palpate_edge.common.contact import Contact
from palpate_edge.common.terminal.bar_chart import LABEL_COLUMNS, bar_chart, binned
from palpate_edge.common.terminal.lines import (
    GREEN,
    GREY,
    RED,
    YELLOW,
    Line,
    Palette,
    Rgb,
    Span,
    beside,
    number_text,
    text_line,
)
from palpate_edge.console.terminal.dome_lines import dome_lines
from palpate_edge.console.terminal.fingertip_view import FORCE_S, FingertipView
from palpate_edge.console.terminal.picture_cells import picture_lines, picture_size
from palpate_edge.daemon.check_rows import CheckRow, Verdict

LEAST_SIZE = (60, 16)
ARROW = " " * 8 + "-> "
FIGURE_COLUMNS = 36
FORCE_ROWS = 4
DOME_ROWS = 8, 16
OLD_S = 1.0
"""A picture older than this is marked."""
KEYS = "r record  s snapshot  t tare  b blink LEDs  q quit"
COLOURS: dict[Verdict, Rgb] = {
    Verdict.FAIL: RED,
    Verdict.WARN: YELLOW,
    Verdict.OK: GREEN,
    Verdict.ABSENT: GREY,
}


def fingertip_lines(
    view: FingertipView, now_s: float, columns: int, rows: int, palette: Palette
) -> list[Line]:
    """Return the `rows` lines of the screen, each for `columns` columns at most.

    From top to bottom: name and connection; picture, figures and, where there is space, the dome; force
    over time; health, what is out of order first with its remedy; answer to the last command; keys.
    """
    if columns < LEAST_SIZE[0] or rows < LEAST_SIZE[1]:
        least = "{} x {}".format(*LEAST_SIZE)
        return [text_line(f"{columns} x {rows} is too small: at least {least}; q quits")]
    health = _health_lines(view, columns)
    health_rows = min(len(health), rows // 5)
    middle_rows = rows - 3 - FORCE_ROWS - health_rows
    return [
        _head(view, now_s),
        *_middle(view, now_s, columns, middle_rows, palette),
        *_force(view, now_s, columns, palette),
        *health[:health_rows],
        text_line(view.notice, YELLOW),
        text_line(KEYS, GREY),
    ]


def _head(view: FingertipView, now_s: float) -> Line:
    age_s = view.picture_age_s(now_s)
    old = f"  no picture for {age_s:.1f} s" if age_s is not None and age_s > OLD_S else ""
    colour = GREEN if view.state.connected else RED
    return [Span(f"{view.name}  "), Span(view.state.text, colour), Span(old, YELLOW)]


def _middle(view: FingertipView, now_s: float, columns: int, rows: int, palette: Palette) -> list[Line]:
    """Return exactly `rows` lines: picture, figures, dome."""
    figures = _figures(view, now_s)
    radius_mm = view.outer_radius_mm
    space = columns - FIGURE_COLUMNS - 1
    contact = None if view.frame is None else view.frame.contact
    below, aside = (min(most, DOME_ROWS[1]) for most in (rows - len(figures), rows))
    if radius_mm is not None and below >= DOME_ROWS[0]:
        figures += dome_lines(contact, radius_mm, below)
    elif radius_mm is not None and space - 2 * aside >= columns // 3:
        space -= 2 * aside
        figures = beside(figures, FIGURE_COLUMNS, dome_lines(contact, radius_mm, aside))
    if view.frame is None or view.image is None:
        lines = beside([text_line("no picture yet", GREY)], space + 1, figures)
    else:
        cells = picture_size(view.frame.size_px, space, rows)
        picture = picture_lines(view.image, view.frame.beads, view.frame.size_px, cells, palette)
        lines = beside(picture, cells[0] + 1, figures)
    return [*lines[:rows], *([] for _ in range(rows - len(lines)))]


def _figures(view: FingertipView, now_s: float) -> list[Line]:
    health, frame = view.health, view.frame
    rows = [("rate", "–" if health is None else f"{health.fps:.1f} frames/s, {health.dropped} dropped")]
    if frame is not None:
        rows = [*_contact_figures(frame.contact), *rows]
        rows.append(("latency", f"{frame.latency_ms:.1f} ms"))
        rows.append(("pictures", f"{view.pictures_per_s(now_s):.1f} /s"))
    if health is not None:
        light = health.light
        rows.append(("bus state", health.nmt_state or "no daemon"))
        if light is not None:
            rows.append(("silicone", number_text(light.silicone_degC, 1, "°C")))
        rows.append(("recording", health.recording or "no"))
    return [[Span(f"{name:<12}", GREY), Span(value)] for name, value in rows]


def _contact_figures(contact: Contact) -> list[tuple[str, str]]:
    """Return names and values, in the order of the page."""
    touch = "slips" if contact.slip else "yes" if contact.in_contact else "none"
    shear_N = math.hypot(*contact.shear_N) if contact.shear_N else None
    place = contact.position_mm
    expected = f" of {contact.beads_expected}" if contact.beads_expected else ""
    return [
        ("contact", touch if contact.valid else contact.reason),
        ("position", "–" if place is None else "{:.1f}, {:.1f}, {:.1f} mm".format(*place)),
        ("95 % radius", number_text(contact.radius95_mm, 2, "mm")),
        ("normal", number_text(contact.normal_force_N, 2, "N")),
        ("shear", number_text(shear_N, 2, "N")),
        ("torsion", number_text(contact.torsion_Nmm, 1, "N mm")),
        *((one.label, f"{one.value:.2f} ± {one.half_width95:.2f}") for one in contact.pose),
        ("beads", f"{contact.beads_found}{expected}"),
    ]


def _force(view: FingertipView, now_s: float, columns: int, palette: Palette) -> list[Line]:
    values = binned(view.forces, now_s, FORCE_S, columns - LABEL_COLUMNS)
    return bar_chart(values, FORCE_ROWS, "N", palette)


def _health_lines(view: FingertipView, columns: int) -> list[Line]:
    """Return what is out of order with its remedy, failures first, then one line of all other parts."""
    if view.health is None:
        return [text_line("no health report yet", GREY)]
    rows = view.health.rows
    lines = [
        line
        for verdict in (Verdict.FAIL, Verdict.WARN)
        for row in rows
        for line in _problem(row, verdict, columns)
    ]
    well = [row for row in rows if row.verdict in (Verdict.OK, Verdict.ABSENT)]
    return [*lines, [Span("ok      ", GREEN), Span(", ".join(row.part for row in well))]]


def _problem(row: CheckRow, verdict: Verdict, columns: int) -> list[Line]:
    if row.verdict is not verdict:
        return []
    head = [Span(f"{verdict.value:<8}", COLOURS[verdict]), Span(f"{row.part}: {row.value}")]
    remedy = textwrap.wrap(row.way_out, columns, initial_indent=ARROW, subsequent_indent=" " * len(ARROW))
    return [head, *map(text_line, remedy)]
