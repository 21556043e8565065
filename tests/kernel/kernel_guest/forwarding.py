"""The pytest plugin: outside it sends marked tests to their machine, inside it records their outcomes."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec
import pytest

from kernel_guest.run import Machine, Outcome, Run
from kernel_guest.user_mode import UserModeLinux
from kernel_guest.virtual_machine import VirtualMachine

MACHINES: dict[str, Machine] = {"uml": UserModeLinux(), "vm": VirtualMachine()}
OUTCOMES = os.environ.get("PALPATE_OUTCOMES")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Inside(Path(OUTCOMES)) if OUTCOMES else Outside(config))


class Outside:
    """Run marked tests by reading their outcomes; the first boots the machine for all of them.

    Its fixtures are set up inside, so here it has none. Parallel workers each boot for the files they get.
    """

    def __init__(self, config: pytest.Config) -> None:
        self._project = config.rootpath
        self._options = [f"--effort={config.getoption('--effort')}", "-m", config.option.markexpr]
        self._a_file_at_a_time = hasattr(config, "workerinput")  # pytest-xdist with --dist loadfile
        self._wanted: dict[tuple[str, Path], list[str]] = {}
        self._runs: dict[tuple[str, Path], Run] = {}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        # A virtual machine under emulation takes minutes, so it starts only when its marker is given.
        if "vm" not in config.option.markexpr:
            left_out = [item for item in items if item.get_closest_marker("vm")]
            items[:] = [item for item in items if item not in left_out]
            config.hook.pytest_deselected(items=left_out)
        for item in items:
            name = next((name for name in MACHINES if item.get_closest_marker(name)), None)
            if name is not None:
                self._send_in(item, name)

    def pytest_unconfigure(self) -> None:
        for run in self._runs.values():
            run.close()

    def _send_in(self, item: pytest.Item, name: str) -> None:
        key = (name, item.path if self._a_file_at_a_time else self._project)
        self._wanted.setdefault(key, []).append(item.nodeid)
        item.setup = lambda: None
        item.runtest = lambda: self._ask(key, item.nodeid)

    def _ask(self, key: tuple[str, Path], test: str) -> None:
        machine = MACHINES[key[0]]
        if (missing := machine.missing()) is not None:
            pytest.skip(missing)
        if key not in self._runs:
            self._runs[key] = Run(machine, self._project, self._wanted[key], self._options)
        outcome = self._runs[key].outcome(test)
        if outcome.outcome == "skipped":
            pytest.skip(f"inside {key[0]}: {outcome.text}")
        if outcome.outcome == "failed":
            pytest.fail(f"inside {key[0]}:\n{outcome.text}", pytrace=False)
        if outcome.text:
            print(outcome.text)  # figures that the test printed


class Inside:
    """Write a line for each finished test and flush it, because pytest outside reads it meanwhile."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("ab")
        self._reports: list[pytest.TestReport] = []

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._reports.append(report)
        if report.when != "teardown":
            return
        self._file.write(msgspec.json.encode(_outcome(self._reports)) + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        self._reports = []


def _outcome(reports: list[pytest.TestReport]) -> Outcome:
    """Return the worst of the reports of a test's setup, call and teardown."""
    test = reports[0].nodeid
    failed = [report for report in reports if report.failed]
    if failed:
        parts = [part for report in failed for part in (report.longreprtext, *_captured(report))]
        return Outcome(test, "failed", "\n".join(parts))
    skipped = next((report for report in reports if report.skipped), None)
    if skipped is not None:
        return Outcome(test, "skipped", str(skipped.longrepr[-1]))
    return Outcome(test, "passed", "\n".join(report.capstdout for report in reports if report.when == "call"))


def _captured(report: pytest.TestReport) -> list[str]:
    return [f"--- {title} ---\n{text}" for title, text in report.sections if text]
