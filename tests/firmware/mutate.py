"""Breaks the firmware in one place at a time and counts how often its tests notice.

python tests/firmware/mutate.py [core.c] [main.c]

core.c is tested by the properties of the logic, main.c by the real binary on simulated wires. A mutant
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
    compile: tuple[tuple[str, ...], ...]  # in the folder of the sources; {build} is another one


TARGETS = (
    Target(
        "core.c",
        "static const int16_t thermistor",
        "test_logic.py",
        (("cc", "-fsyntax-only", "-Wall", "-Werror", "core.c"), ("make", "BUILD={build}")),
    ),
    Target("main.c", "INLINE void switch_led", "test_wire.py", (("make", "BUILD={build}"),)),
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
STATEMENT = re.compile(r"^\s+[^/#].*;(\s*/\*.*)?$")


@dataclass(frozen=True)
class Mutant:
    target: Target
    number: int
    line: str
    after: str
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
            source = "\n".join([*lines[:index], text, *lines[index + 1 :]])
            yield Mutant(target, index + 1, shown, lines[index - 1].strip(), source)


def run(command: list[str], environment: dict[str, str], folder: Path) -> bool:
    try:
        done = subprocess.run(
            command, capture_output=True, check=False, cwd=folder, env=environment, timeout=TIME_LIMIT_S
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
        for command in mutant.target.compile:
            if not run([part.format(build=f"{name}/build") for part in command], environment, folder):
                return None
        tests = HERE / mutant.target.tests
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", str(tests)]
        return run(command, environment, HERE)


def is_equivalent(mutant: Mutant) -> bool:
    """Whether equivalent_mutants.toml has this line (after the line it names, where several are alike)."""
    table = tomllib.loads((HERE / "equivalent_mutants.toml").read_text())["mutant"]
    of_line = [each for each in table if (each["file"], each["line"]) == (mutant.target.name, mutant.line)]
    return any(each.get("after", mutant.after) == mutant.after for each in of_line)


def score(target: Target, processes: int) -> bool:
    """Prints survivors and the share of mutants killed; whether none survived."""
    original = Mutant(target, 0, "no mutation", "", (SOURCES / target.name).read_text())
    if not survives(original):
        print(f"error: {target.tests} fails without a mutation: mend that first")
        return False
    every = [mutant for mutant in mutants(target) if not is_equivalent(mutant)]
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
