"""Breaks the firmware in one place at a time and counts how often its tests notice.

python tests/firmware/mutate.py [core.c] [main.c]

core.c is asked by the tests of the logic, main.c by those of the real binary on simulated wires. A mutant
that survives is printed with its line; those that no test can notice stand with their reason in
equivalent_mutants.toml. Exit status 1 when another one survives.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
SOURCES = HERE.parents[1] / "firmware" / "illumination"
TIME_LIMIT_S = 180  # a mutant that never ends is noticed


@dataclass(frozen=True)
class Target:
    """A source, where its code begins, and the tests that should notice a change."""

    name: str
    first_line: str
    tests: str


TARGETS = (
    Target("core.c", "static const int16_t thermistor", "test_logic.py"),
    Target("main.c", "INLINE void switch_led", "test_wire.py"),
)
SWAPS = {
    " < ": " <= ",
    " <= ": " < ",
    " > ": " >= ",
    " >= ": " > ",
    " == ": " != ",
    " != ": " == ",
    " && ": " || ",
    " || ": " && ",
    " | ": " & ",
    " & ": " | ",
    " + ": " - ",
    " - ": " + ",
    " |= ": " &= ",
    " ^= ": " |= ",
    " << ": " >> ",
    " >> ": " << ",
    "++": "--",
    "!": "",
    "true": "false",
    "false": "true",
    "return ": "return !",
    " = 0;": " = 1;",
}
STATEMENT = re.compile(r"^\s+(?!return|break|static|bool |u?int\d+_t )[^/#].*;(\s*/\*.*)?$")


@dataclass(frozen=True)
class Mutant:
    target: Target
    number: int
    line: str
    text: str

    def __str__(self) -> str:
        return f"{self.target.name}:{self.number}: {self.line}"


def mutants(target: Target) -> Iterator[Mutant]:
    """One for each operator in each line of code, and one without the line where it is a statement."""
    lines = (SOURCES / target.name).read_text().splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(target.first_line))
    for index in range(start, len(lines)):
        line = lines[index]
        if line.lstrip().startswith(("/*", "*", "#", "//")):
            continue
        code = line.split("/*")[0]
        changed = [
            code[: match.start()] + new + code[match.end() :]
            for old, new in SWAPS.items()
            for match in re.finditer(re.escape(old), code)
        ]
        if STATEMENT.match(line):
            changed.append("")
        for text in changed:
            shown = text.strip() or f"without {code.strip()}"
            yield Mutant(target, index + 1, shown, "\n".join([*lines[:index], text, *lines[index + 1 :]]))


def run(command: list[str | Path], environment: dict[str, str]) -> bool:
    try:
        done = subprocess.run(
            command, capture_output=True, check=False, env=environment, timeout=TIME_LIMIT_S
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def survives(mutant: Mutant) -> bool | None:
    """Whether the tests pass with this source; None when it does not compile."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "illumination"
        shutil.copytree(SOURCES, folder, ignore=shutil.ignore_patterns("build"))
        (folder / mutant.target.name).write_text(mutant.text + "\n")
        environment = os.environ | {"PALPATE_FIRMWARE": str(folder)}
        if not run(["make", "-s", "-C", folder, f"BUILD={name}/build"], environment):
            return None
        tests = HERE / mutant.target.tests
        return run([sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", tests], environment)


def equivalent() -> set[tuple[str, str]]:
    table = tomllib.loads((HERE / "equivalent_mutants.toml").read_text())
    return {(each["file"], each["line"]) for each in table["mutant"]}


def score(target: Target, processes: int) -> bool:
    """Prints survivors and the share of mutants killed; whether none survived."""
    original = Mutant(target, 0, "no mutation", (SOURCES / target.name).read_text())
    if not survives(original):
        print(f"error: {target.tests} fails without a mutation: mend that first")
        return False
    known = equivalent()
    every = [mutant for mutant in mutants(target) if (target.name, mutant.line) not in known]
    killed = total = 0
    with ThreadPoolExecutor(processes) as pool:
        for count, (mutant, alive) in enumerate(zip(every, pool.map(survives, every), strict=True), 1):
            if alive:
                print(f"survived: {mutant}", flush=True)
            total += alive is not None
            killed += alive is False
            print(f"{target.name}: {count} of {len(every)}", end="\r", file=sys.stderr)
    print(f"{target.name}: {killed} of {total} mutants killed ({100 * killed / total:.1f} %)", flush=True)
    return killed == total


def main() -> int:
    parser = argparse.ArgumentParser(description="Count how often the firmware's tests notice a broken line.")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("sources", nargs="*", default=[target.name for target in TARGETS])
    arguments = parser.parse_args()
    chosen = [target for target in TARGETS if target.name in arguments.sources]
    scores = [score(target, arguments.processes) for target in chosen]
    return 0 if all(scores) else 1


if __name__ == "__main__":
    sys.exit(main())
