"""Breaks the sources in one place at a time and counts how often the tests notice.

Mutants are drawn from the areas in areas.toml. Each one stands in a copy of the source trees and is
run by the tests that cover its line, as a recorded run says. The checkout is never edited.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import Queue

from tests.mutation.covering import CoveringTests, failed_tests
from tests.mutation.operators import Mutant, mutants_of
from tests.mutation.report import Result, markdown, write_report

ROOT = Path(__file__).resolve().parents[2]
TREES = ("edge", "host")
MEMORY = 8 << 30  # bytes: a mutant may want all there is
SLACK = 4  # a mutant may take so many times what its tests took
EXAMPLE = """example: record a run, then try 320 mutants on two cores
  make coverage
  python -m tests.mutation.run --seed 1 --workers 2
"""


def sample(number: int, seed: int) -> list[tuple[str, Mutant]]:
    """Return that many mutants, divided among the areas in proportion to their lines.

    The draw depends on a mutant's own lines and not on where they stand: when files move, the same mutants
    are drawn again.
    """
    areas: dict[str, list[str]] = tomllib.loads((Path(__file__).parent / "areas.toml").read_text())
    files = {
        area: sorted({path for glob in globs for path in ROOT.glob(glob)}) for area, globs in areas.items()
    }
    lines = {area: sum(len(path.read_text().splitlines()) for path in paths) for area, paths in files.items()}
    drawn: list[tuple[str, Mutant]] = []
    for area, paths in files.items():
        repeated: Counter[str] = Counter()
        ranked: list[tuple[str, Mutant]] = []
        for mutant in (mutant for path in paths for mutant in mutants_of(ROOT, str(path.relative_to(ROOT)))):
            key = f"{seed}|{mutant.before}|{mutant.after}"
            repeated[key] += 1
            ranked.append((hashlib.sha256(f"{key}|{repeated[key]}".encode()).hexdigest(), mutant))
        ranked.sort(key=lambda pair: pair[0])
        share = round(number * lines[area] / sum(lines.values()))
        drawn += [(area, mutant) for _, mutant in ranked[:share]]
    return drawn


def run_tests(copy: Path, tests: list[str], limit_s: float, *words: str) -> tuple[int | None, str]:
    """Return pytest's exit status, None when time ran out, and its output. The sources are the copy's."""
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(str(copy / tree) for tree in TREES),
        "PYTHONDONTWRITEBYTECODE": "1",
        "HYPOTHESIS_STORAGE_DIRECTORY": str(copy / "hypothesis"),
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words, *tests]
    output = copy / "output.txt"
    with output.open("w") as file:  # not a pipe: what a test left behind would hold it open
        process = subprocess.Popen(
            command, cwd=ROOT, env=environment, stdout=file, stderr=file, start_new_session=True
        )
        resource.prlimit(process.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
        status = None
        with contextlib.suppress(subprocess.TimeoutExpired):
            status = process.wait(limit_s)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return status, output.read_text(errors="replace")


class Laboratory:
    """Copies of the source trees, one for each worker, in which mutants meet their tests."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options = options
        self._covering = CoveringTests(ROOT, options.coverage, options.log)
        self._copies: Queue[Path] = Queue()
        for number in range(options.workers):
            copy = options.build / f"worker-{number}"
            shutil.rmtree(copy, ignore_errors=True)
            for tree in TREES:
                shutil.copytree(ROOT / tree, copy / tree)
            self._copies.put(copy)

    def check_unmutated(self, mutants: list[Mutant]) -> set[str]:
        """Run every test that will be asked on unchanged sources; leave out and return those that fail."""
        tests = sorted({test for mutant in mutants for test in self._chosen(mutant)})
        copy = self._copies.get()
        print(f"{len(tests)} tests on unchanged sources", flush=True)
        workers = ("-n", str(self._options.workers), "--dist", "loadfile")
        status, output = run_tests(copy, tests, 3600, *workers)
        self._copies.put(copy)
        if status not in (0, 1):
            sys.exit(f"the tests cannot run on unchanged sources:\n{output}")
        failed = failed_tests(output)
        self._covering.leave_out(failed)
        return failed

    def result(self, area: str, mutant: Mutant) -> Result:
        covering, tests = len(self._covering.of(mutant)), self._chosen(mutant)
        if not tests:
            return Result(area, mutant, "uncovered", 0, 0, "", 0.0)
        copy = self._copies.get()
        target, begin = copy / mutant.path, time.monotonic()
        target.write_text(mutant.text)
        limit_s = self._options.limit_s + SLACK * self._covering.seconds(tests)
        status, output = run_tests(copy, tests, limit_s, "-x")
        shutil.copy2(ROOT / mutant.path, target)
        self._copies.put(copy)
        outcome = "timeout" if status is None else "killed" if status else "survived"
        by = min(failed_tests(output), default="")
        return Result(area, mutant, outcome, len(tests), covering, by, round(time.monotonic() - begin, 1))

    def _chosen(self, mutant: Mutant) -> list[str]:
        """Return the first covering tests that fit into the limits, those of a file together."""
        tests = self._covering.of(mutant)[: self._options.tests]
        while len(tests) > 1 and self._covering.seconds(tests) > self._options.tests_s:
            tests.pop()
        files = list(dict.fromkeys(test.split("::")[0] for test in tests))
        return sorted(tests, key=lambda test: files.index(test.split("::")[0]))


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, epilog=EXAMPLE, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    build, recorded = ROOT / "build" / "mutation", ROOT / "build" / "coverage"
    parser.add_argument("--mutants", type=int, default=320, help="how many to try (320)")
    parser.add_argument("--seed", type=int, default=1, help="of the draw (1)")
    parser.add_argument("--workers", type=int, default=1, help="how many run at a time (1)")
    parser.add_argument("--tests", type=int, default=60, help="at most so many for a mutant (60)")
    parser.add_argument("--tests-s", type=float, default=30, help="that took at most so long together (30 s)")
    parser.add_argument(
        "--limit-s", type=float, default=60, help="a mutant's limit, and 4 times its tests (60 s)"
    )
    parser.add_argument("--build", type=Path, default=build, help="where sources are copied (build/mutation)")
    parser.add_argument(
        "--coverage", type=Path, default=recorded / "data", help="coverage data with contexts"
    )
    parser.add_argument(
        "--log", type=Path, default=recorded / "tests.log", help="pytest's output of that run"
    )
    parser.add_argument("--output", type=Path, default=build / "report", help="writes .json and .md")
    options = parser.parse_args()
    drawn = sample(options.mutants, options.seed)
    laboratory = Laboratory(options)
    for test in sorted(laboratory.check_unmutated([mutant for _, mutant in drawn])):
        print(f"left out, fails on unchanged sources: {test}")
    results: list[Result] = []
    with ThreadPoolExecutor(options.workers) as pool:
        for done in as_completed([pool.submit(laboratory.result, *pair) for pair in drawn]):
            results.append(done.result())
            last = results[-1]
            place = f"{last.mutant.path}:{last.mutant.line}"
            print(f"{len(results)}/{len(drawn)} {last.outcome} {place} {last.seconds} s", flush=True)
            write_report(results, options.seed, options.output)
    print(markdown(results))


if __name__ == "__main__":
    main()
