"""Forwarding into a guest: pytest reports the outcomes of the guest, and no process is left over."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from kernel_guest.run import Run
from kernel_guest.user_mode import UserModeLinux

KERNEL_TESTS = Path(__file__).parent

INNER = """
import os, pathlib, time
import pytest

def test_passes():
    assert pathlib.Path("/proc/version").read_text().startswith("Linux version 6")
    assert os.getuid() == 0

def test_fails():
    print("said before")
    assert 1 + 1 == 3

@pytest.fixture
def broken():
    yield
    raise OSError("at the end")

def test_fails_at_the_end(broken):
    pass

def test_skips():
    pytest.skip("no such thing")

def test_writes_outside():
    pathlib.Path(__file__).write_text("")

def test_hangs():
    time.sleep(1000)

def test_never_comes():
    pass
"""


EFFORT = """
import pytest

@pytest.mark.uml
def test_effort(pytestconfig):
    assert pytestconfig.getoption("--effort") == "full"
"""


def names_of_processes() -> list[str]:
    return [path.read_text() for path in Path("/proc").glob("[0-9]*/cmdline")]


@pytest.fixture
def project(tmp_path):
    """A folder whose tests are forwarded."""
    (tmp_path / "pytest.ini").write_text(f"[pytest]\npythonpath = {KERNEL_TESTS} {KERNEL_TESTS.parents[1]}\n")
    plugins = ["tests.tiers", "kernel_guest.forwarding"]
    (tmp_path / "conftest.py").write_text(f"pytest_plugins = {plugins}\n")
    return tmp_path


@pytest.fixture
def run(project):
    machine = UserModeLinux()
    if (missing := machine.missing()) is not None:
        pytest.skip(missing)
    machine.limit_s = 25.0
    (project / "test_inner.py").write_text(INNER)
    names = [line[4:].split("(")[0] for line in INNER.splitlines() if line.startswith("def test")]
    running = Run(machine, project, [f"test_inner.py::{name}" for name in names])
    yield running
    running.close()


@pytest.mark.slow
def test_outcomes_come_out_and_a_machine_that_hangs_is_ended(run):
    assert run.outcome("test_inner.py::test_passes").outcome == "passed"
    failed = run.outcome("test_inner.py::test_fails")
    assert failed.outcome == "failed"
    assert "assert (1 + 1) == 3" in failed.text
    assert "said before" in failed.text
    late = run.outcome("test_inner.py::test_fails_at_the_end")
    assert (late.outcome, "OSError: at the end" in late.text) == ("failed", True)
    skipped = run.outcome("test_inner.py::test_skips")
    assert (skipped.outcome, skipped.text) == ("skipped", "Skipped: no such thing")
    assert "Read-only file system" in run.outcome("test_inner.py::test_writes_outside").text
    assert any(str(run.folder) in name for name in names_of_processes())
    hung = run.outcome("test_inner.py::test_hangs")
    assert hung.outcome == "failed"
    assert "user-mode-linux ended before this test did, or was ended after 25 s" in hung.text
    assert not any(str(run.folder) in name for name in names_of_processes())


def test_closing_ends_a_machine_at_work(run):
    assert run.outcome("test_inner.py::test_skips").outcome == "skipped"
    run.close()
    assert not any(str(run.folder) in name for name in names_of_processes())


@pytest.mark.slow
def test_the_effort_outside_is_the_effort_inside(project):
    if (missing := UserModeLinux().missing()) is not None:
        pytest.skip(missing)
    (project / "test_effort.py").write_text(EFFORT)
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--effort=full", project]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert "1 passed" in done.stdout
