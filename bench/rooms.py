"""Draw the rooms of the code and list them: docs/rooms.svg and the tables of docs/overview.md.

python -m bench.rooms

The floors come from the layers contracts in pyproject.toml, the sentences from the docstrings of rooms and
modules, so the map cannot differ from the code.
"""

from __future__ import annotations

import ast
import itertools
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE, PICTURE = ROOT / "docs" / "overview.md", ROOT / "docs" / "rooms.svg"
FOLDERS = {"palpate_edge": "edge", "palpate_bus": "host", "palpate_host": "host", "palpate_twin": "host"}
TITLES = {
    "palpate_edge": "palpate_edge: on the fingertip's board",
    "palpate_bus": "palpate_bus: any CANopen bus",
    "palpate_host": "palpate_host: beside the hand",
    "palpate_twin": "palpate_twin: the simulation",
}
WAY = (
    ("palpate_edge", "capture", "frame"),
    ("palpate_edge", "vision", "beads"),
    ("palpate_edge", "estimation", "contact"),
    ("palpate_edge", "daemon", "publish"),
    ("palpate_edge", "node", "TPDO"),
    ("palpate_edge", "can_bus", "CAN frame"),
    ("palpate_host", "service", "receive"),
    ("palpate_host", "network", "contact"),
    ("palpate_host", "control", "torques"),
    ("palpate_host", "safety", "limits"),
    ("palpate_host", "drives", "RPDO"),
)
"""Rooms that a frame passes, and the value that leaves each."""

RULE = (
    "A room may import from lower floors of its column. The twin may use the host, the host the bus tools;",
    "both may use common, can_bus, node and web of palpate_edge.",
)
WIDTH, FLOOR, BOX, GAP, TOP = 300, 58, 40, 14, 64


@dataclass(frozen=True)
class Room:
    """One sub-package. use: floor counted from the top; column of columns: its place on that floor."""

    package: str
    name: str
    use: int
    column: int
    columns: int

    @property
    def folder(self) -> Path:
        return ROOT / FOLDERS[self.package] / self.package / self.name


def rooms() -> list[Room]:
    """Return all rooms, floor by floor from the top, as the layers contracts name them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    found = []
    for package in FOLDERS:
        layers = next(c["layers"] for c in contracts if c.get("containers") == [package])
        for use, layer in enumerate(layers):
            names = [name.strip() for name in layer.split("|")]
            found += [Room(package, name, use, i, len(names)) for i, name in enumerate(names)]
    return found


def sentence(path: Path) -> str:
    """Return the first paragraph of a module's docstring, on one line."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split())


def modules(folder: Path) -> list[Path]:
    """Return the modules of a room and of the folders inside it, `__init__` left out."""
    return sorted(path for path in folder.rglob("*.py") if path.name != "__init__.py")


def picture() -> str:
    """Return the SVG: a column a package, a floor a layer, and the way of a frame."""
    everything = rooms()
    floors = max(room.use for room in everything) + 1
    height = TOP + floors * FLOOR + 76
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {len(FOLDERS) * (WIDTH + 20) + 20} {height}" '
        'font-family="sans-serif" font-size="13">',
        '<rect width="100%" height="100%" fill="#ffffff"/>',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" '
        'orient="auto"><path d="M0 0 L8 4 L0 8 z" fill="#c2410c"/></marker></defs>',
    ]
    for number, (package, title) in enumerate(TITLES.items()):
        x = 20 + number * (WIDTH + 20)
        parts.append(
            f'<rect x="{x - 8}" y="14" width="{WIDTH + 12}" height="{height - 28}" rx="8" fill="#f1f5f9"/>'
        )
        parts.append(f'<text x="{x}" y="40" font-weight="bold">{escape(title)}</text>')
        parts += [_box(room, x) for room in everything if room.package == package]
    parts += list(_way(everything))
    way = [f"{number} {name} ({value})" for number, (_, name, value) in enumerate(WAY, start=1)]
    legend = (" ".join(RULE), "A frame: " + ", ".join(way[:6]) + ",", ", ".join(way[6:]))
    for line, text in enumerate(legend):
        parts.append(f'<text x="20" y="{height - 50 + 20 * line}" fill="#475569">{escape(text)}</text>')
    parts.append("</svg>")
    return "\n".join(parts) + "\n"


def _place(room: Room) -> tuple[float, float, float]:
    """Return left edge, top and width of a room's box, measured in its column."""
    width = (WIDTH - 10 - GAP * (room.columns - 1)) / room.columns
    return room.column * (width + GAP), TOP + room.use * FLOOR, width


def _box(room: Room, x: float) -> str:
    left, top, width = _place(room)
    on_way = any((package, name) == (room.package, room.name) for package, name, _ in WAY)
    fill = "#ffedd5" if on_way else "#ffffff"
    return (
        f'<rect x="{x + left:.0f}" y="{top}" width="{width:.0f}" height="{BOX}" rx="5" fill="{fill}" '
        f'stroke="#64748b"/><text x="{x + left + width / 2:.0f}" y="{top + 25}" text-anchor="middle">'
        f"{escape(room.name)}</text>"
    )


def _way(everything: list[Room]) -> Iterator[str]:
    packages = list(FOLDERS)
    ends = []
    for number, (package, name, _) in enumerate(WAY, start=1):
        room = next(r for r in everything if (r.package, r.name) == (package, name))
        left, top, width = _place(room)
        x = 20 + packages.index(package) * (WIDTH + 20) + left + width - 8
        ends.append((x, top + 4, number))
    for (x0, y0, _), (x1, y1, _) in itertools.pairwise(ends):
        bend = max(x0, x1) + (26 if abs(x0 - x1) < WIDTH else 0)
        middle = (x0 + x1) / 2 if abs(x0 - x1) >= WIDTH else bend
        yield (
            f'<path d="M{x0:.0f} {y0:.0f} C{middle:.0f} {y0:.0f} {middle:.0f} {y1:.0f} {x1:.0f} {y1:.0f}" '
            'fill="none" stroke="#c2410c" stroke-width="1.5" marker-end="url(#tip)" opacity="0.8"/>'
        )
    for x, y, number in ends:
        yield f'<circle cx="{x:.0f}" cy="{y:.0f}" r="9" fill="#c2410c"/>'
        yield (
            f'<text x="{x:.0f}" y="{y + 4:.0f}" fill="#ffffff" text-anchor="middle" font-size="11">'
            f"{number}</text>"
        )


def table_of_rooms() -> str:
    """Return the Markdown table of all rooms."""
    lines = ["| room | floor | content | modules |", "|---|---|---|---|"]
    for room in rooms():
        what = sentence(room.folder / "__init__.py")
        count = len(modules(room.folder))
        name = f"[`{room.package}.{room.name}`](#{room.package}{room.name})"
        lines.append(f"| {name} | {room.use + 1} | {what} | {count} |")
    return "\n".join(lines)


def tables_of_files() -> str:
    """Return one Markdown table of modules for each room."""
    lines = []
    for room in rooms():
        lines += [f"### {room.package}.{room.name}", "", "| file | subject |", "|---|---|"]
        for path in modules(room.folder):
            shown = path.relative_to(room.folder).as_posix()
            link = f"../{path.relative_to(ROOT).as_posix()}"
            lines.append(f"| [`{shown}`]({link}) | {sentence(path)} |")
        lines.append("")
    return "\n".join(lines).rstrip()


def filled(page: str) -> str:
    """Return the page with its generated parts renewed."""
    for name, text in (("rooms", table_of_rooms()), ("files", tables_of_files())):
        begin, end = f"<!-- {name}: made by python -m bench.rooms -->", f"<!-- end of {name} -->"
        page = re.sub(
            re.escape(begin) + ".*?" + re.escape(end),
            lambda _match, begin=begin, end=end, text=text: f"{begin}\n{text}\n{end}",
            page,
            flags=re.DOTALL,
        )
    return page


def main() -> None:
    PICTURE.write_text(picture(), encoding="utf-8")
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
