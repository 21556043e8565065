"""Print the slowest tests of the last runs of each tier: `python -m tests.slowest [NUMBER]` (30)."""

from __future__ import annotations

import sys
from datetime import datetime
from pathlib import Path
from xml.etree import ElementTree

RESULTS = Path(__file__).resolve().parents[1] / ".cache" / "tests"
"""Where make has pytest write a JUnit file for each tier."""


def durations(results: Path) -> list[tuple[float, str, str]]:
    """Return (seconds, tier, test) of every test in a folder of JUnit files, the slowest first."""
    rows = []
    for path in sorted(results.glob("*.xml")):
        for case in ElementTree.parse(path).iter("testcase"):
            test = f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}"
            rows.append((float(case.get("time", 0)), path.stem, test))
    return sorted(rows, reverse=True)


def main() -> None:
    number = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    rows = durations(RESULTS)
    if not rows:
        sys.exit("error: no run has been recorded: run make check or make test first")
    for path in sorted(RESULTS.glob("*.xml")):
        of_tier = [seconds for seconds, tier, _ in rows if tier == path.stem]
        ended = datetime.fromtimestamp(path.stat().st_mtime).isoformat(" ", "minutes")
        print(f"{path.stem}: {len(of_tier)} tests, {sum(of_tier):.0f} s over all workers, ended {ended}")
    print()
    for seconds, tier, test in rows[:number]:
        print(f"{seconds:7.2f} s  {tier:6}  {test}")


if __name__ == "__main__":
    main()
