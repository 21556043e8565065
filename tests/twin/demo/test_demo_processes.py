"""Processes that die, end with an error, or that must not outlive their parent. All of them are hubs."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from palpate_twin.demo.processes import Children, DemoError, Program

PARENT = """
import sys, time
from pathlib import Path
from palpate_twin.demo.processes import Children, Program
folder = Path(sys.argv[1])
with Children(folder) as children:
    children.start("hub", Program.HOST, ["bus", "hub", "--socket", str(folder / "hub.sock")])
    print("started", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def folder(tmp_path, processes_of):
    yield tmp_path
    assert processes_of(tmp_path) == {}


def is_listening(folder, name="hub"):
    """Return whether the hub has installed its signal handlers, shown by a line on stderr."""
    path = folder / f"{name}.stderr"
    return path.exists() and "listening" in path.read_text()


def hub_arguments(folder, name="hub"):
    return ["bus", "hub", "--socket", str(folder / f"{name}.sock")]


def test_a_killed_process_is_named_with_its_signal(folder, eventually):
    with Children(folder) as children:
        child = children.start("hub", Program.HOST, hub_arguments(folder))
        eventually(lambda: is_listening(folder))
        children.check()
        os.kill(child.process.pid, signal.SIGKILL)
        child.process.wait()
        with pytest.raises(
            DemoError, match=r"^hub ended early \(signal 9\): hub: listening at .*hub\.stderr"
        ):
            children.check()


def test_a_refusal_is_passed_on_in_one_line(folder, eventually):
    with Children(folder) as children:
        child = children.start(
            "hub", Program.HOST, [*hub_arguments(folder), "--log", str(folder / "no" / "l")]
        )
        eventually(lambda: child.process.poll() is not None)
        with pytest.raises(DemoError, match=r"exit status 6\): error: bus log .*No such file") as caught:
            children.check()
        assert "\n" not in str(caught.value)


def test_the_first_to_be_started_is_blamed(folder, eventually):
    with Children(folder) as children:
        started = [children.start(name, Program.HOST, hub_arguments(folder, name)) for name in ("one", "two")]
        for child in reversed(started):
            child.process.kill()
            child.process.wait()
        with pytest.raises(DemoError, match=r"^one ended early"):
            children.find_cause()


def test_stopping_ends_the_named_and_keeps_the_others(folder, eventually):
    with Children(folder) as children:
        one, two = (
            children.start(name, Program.HOST, hub_arguments(folder, name)) for name in ("one", "two")
        )
        eventually(lambda: is_listening(folder, "one") and is_listening(folder, "two"))
        children.stop("one")
        assert one.process.returncode == 0
        assert two.process.poll() is None
        children.check()
    assert not (folder / "one.sock").exists()
    assert not (folder / "two.sock").exists()


def test_an_error_while_stopping_is_told(folder):
    with Children(folder) as children:
        child = children.start("hub", Program.HOST, ["bus", "hub", "--socket", str(folder)])
        child.process.wait()
        with pytest.raises(DemoError, match=r"^hub stopped with an error \(exit status"):
            children.stop("hub")


def test_a_killed_demo_leaves_no_process_and_no_socket(folder, processes_of, eventually):
    with subprocess.Popen([sys.executable, "-c", PARENT, str(folder)], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        parent.stdout.readline()
        eventually(lambda: is_listening(folder))
        assert len(processes_of(folder)) == 2
        parent.kill()
    eventually(lambda: not processes_of(folder))
    assert not (folder / "hub.sock").exists()
