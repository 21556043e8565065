"""Print the line coverage of every room as a table: `python -m tests.coverage_by_room COVERAGE-FILE`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path


def room_of(path: Path) -> str:
    """Return the package and room of a source file, such as palpate_edge/vision."""
    return "/".join(path.parts[1:-1][:2])


def rows(report: dict[str, dict[str, dict[str, dict[str, int]]]]) -> list[tuple[str, int, int]]:
    """Return (room, lines, lines covered) of a `coverage json` report, the total last."""
    lines: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
    for name, file in report["files"].items():
        for key in (room_of(Path(name)), "total"):
            lines[key][0] += file["summary"]["num_statements"]
            lines[key][1] += file["summary"]["covered_lines"]
    ordered = sorted(lines.items(), key=lambda item: (item[0] == "total", item[0]))
    return [(room, number, covered) for room, (number, covered) in ordered]


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "coverage.json"
        command = ["-m", "coverage", "json", "-q", f"--data-file={sys.argv[1]}", "-o", str(path)]
        subprocess.run([sys.executable, *command], check=True)
        report = json.loads(path.read_text())
    print("| room | lines | covered | % |\n|---|---:|---:|---:|")
    for room, lines, covered in rows(report):
        print(f"| {room} | {lines} | {covered} | {100 * covered / max(lines, 1):.1f} |")


if __name__ == "__main__":
    main()
