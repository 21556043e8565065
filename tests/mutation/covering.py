"""Which tests run a line, from one recorded run of the tests with coverage."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

from coverage import CoverageData
from tests.mutation.operators import Mutant

DURATION = re.compile(r"^ *([\d.]+)s (setup|call) +(\S.*?)\s*$", re.MULTILINE)
FAILURE = re.compile(r"^(?:FAILED|ERROR) (\S+?::.*?)(?: - .*)?$", re.MULTILINE)


def failed_tests(log: str) -> set[str]:
    """Return the tests that a run's summary says failed."""
    return {test.strip() for test in FAILURE.findall(log)}


class CoveringTests:
    """The tests of every line, from pytest's coverage data with contexts and its output with durations.

    Tests that failed in the recorded run are left out.
    """

    def __init__(self, root: Path, coverage_file: Path, log_file: Path) -> None:
        self._root = root
        self._data = CoverageData(basename=str(coverage_file))
        self._data.read()
        log = log_file.read_text()
        self._left_out = failed_tests(log)
        self._seconds: defaultdict[str, float] = defaultdict(float)
        self._of_file: defaultdict[str, set[str]] = defaultdict(set)
        for seconds, _, test in DURATION.findall(log):
            self._seconds[test] += float(seconds)
            self._of_file[test.split("::")[0]].add(test)
        self._lines: dict[str, dict[int, list[str]]] = {}

    def leave_out(self, tests: Iterable[str]) -> None:
        """Never return these tests again."""
        self._left_out.update(tests)

    def seconds(self, tests: Iterable[str]) -> float:
        """Return what these tests took in the recorded run."""
        return sum(self._seconds[test] for test in tests)

    def of(self, mutant: Mutant) -> list[str]:
        """Return the tests that run a mutant's line: the fastest case of each, then the second cases ...

        A line that runs at import is seen by every test of its file's functions. A line that runs only while
        fixtures are made is seen by every test of the file that made them: a fixture of the session is
        recorded for its first test alone.
        """
        lines = self._of_lines(mutant.path)
        if mutant.in_function:
            contexts = set(lines.get(mutant.line) or lines.get(mutant.statement_line) or ())
        else:
            contexts = {context for some in lines.values() for context in some}
        tests = {context.rpartition("|")[0] for context in contexts if context}
        if not any(context.endswith("|run") for context in contexts):
            tests |= {other for test in tests for other in self._of_file[test.split("::")[0]]}
        known = [test for test in tests if test in self._seconds and test not in self._left_out]
        known.sort(key=lambda test: (self._seconds[test], test))
        cases: Counter[str] = Counter()
        order: dict[str, int] = {}
        for test in known:
            cases[test.split("[")[0]] += 1
            order[test] = cases[test.split("[")[0]]
        return sorted(known, key=lambda test: order[test])

    def _of_lines(self, path: str) -> dict[int, list[str]]:
        if path not in self._lines:
            self._lines[path] = self._data.contexts_by_lineno(str(self._root / path))
        return self._lines[path]
