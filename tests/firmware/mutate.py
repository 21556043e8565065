"""Breaks core.c in one place at a time and counts how often its tests notice: python tests/firmware/mutate.py

A mutant that survives is printed with its line. The tests of the logic run, not those of the wires.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parents[1] / "firmware" / "illumination"
FIRST_LINE_OF_CODE = "static const int16_t thermistor"
SWAPS = {
    " < ": " <= ",
    " <= ": " < ",
    " > ": " >= ",
    " >= ": " > ",
    " == ": " != ",
    " != ": " == ",
    " && ": " || ",
    " || ": " && ",
    " + ": " - ",
    " - ": " + ",
    " |= ": " &= ",
    " << ": " >> ",
    " >> ": " << ",
    "++": "--",
    "!": "",
    "true": "false",
    "false": "true",
    "return ": "return !",
    " = 0;": " = 1;",
}


def mutants(text: str) -> Iterator[tuple[int, str, str]]:
    """Line number, changed line, changed file: one for each operator in each line of code."""
    lines = text.splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(FIRST_LINE_OF_CODE))
    for number in range(start, len(lines)):
        line = lines[number]
        if line.lstrip().startswith(("/*", "*", "#", "//")):
            continue
        for old, new in SWAPS.items():
            for match in re.finditer(re.escape(old), line):
                changed = line[: match.start()] + new + line[match.end() :]
                yield number + 1, changed.strip(), "\n".join([*lines[:number], changed, *lines[number + 1 :]])


def survives(text: str, folder: Path) -> bool | None:
    """Whether the tests pass with this core.c; None when it does not compile."""
    (folder / "core.c").write_text(text)
    compiled = subprocess.run(
        ["cc", "-std=gnu11", "-fsyntax-only", "-Werror", f"-I{SOURCES}", folder / "core.c"],
        capture_output=True,
        check=False,
    )
    if compiled.returncode:
        return None
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", HERE / "test_logic.py"]
    environment = os.environ | {"PALPATE_CORE_C": str(folder / "core.c")}
    return subprocess.run(command, capture_output=True, check=False, env=environment).returncode == 0


def main() -> int:
    killed = total = 0
    with tempfile.TemporaryDirectory() as name:
        original = (SOURCES / "core.c").read_text()
        if not survives(original, Path(name)):
            print("error: the tests fail without a mutation: mend that first")
            return 1
        for number, line, text in mutants(original):
            alive = survives(text, Path(name))
            if alive is None:
                continue
            total += 1
            killed += not alive
            if alive:
                print(f"survived: core.c:{number}: {line}", flush=True)
    print(f"{killed} of {total} mutants killed ({100 * killed / total:.0f} %)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
