"""The commands of docs/bus.md print what the page says. ``...`` in the page stands for anything on the line.

After a meant change: python tests/bus/cli/test_bus_page.py writes the page's outputs anew.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs" / "bus.md"
BLOCK = re.compile(r"```console\n\$ (?P<command>[^\n]+)\n(?P<output>.*?)```", re.DOTALL)
# Figures that follow the golden logs and the tick: only the words are compared.
LOOSE = ("replay",)


def examples():
    return [(match["command"], match["output"]) for match in BLOCK.finditer(PAGE.read_text())]


@contextmanager
def live_bus(folder):
    """A hub and fingertip 0x10; the environment that finds the hub."""
    path, stopped = folder / "hub.sock", threading.Event()
    hub = [sys.executable, "-m", "palpate_host.cli.main", "bus", "hub", "--socket", str(path)]
    with ExitStack() as stack:
        process = stack.enter_context(subprocess.Popen(hub, stderr=subprocess.PIPE, text=True))
        stack.callback(process.terminate)
        process.stderr.readline()
        bus = stack.enter_context(open_bus(BusConfig(interface="palpate", channel=str(path)), "finger-1"))
        node = FingertipNode(0x10, MethodCode.CORRECTED, "0123456789abcdef", serial_number=42)

        def serve():
            while not stopped.is_set():
                frames = [frame for _, frame in bus.receive(0.01)]
                bus.send(node.process(time.monotonic_ns() // 1000, frames).frames_out)

        server = threading.Thread(target=serve)
        server.start()
        stack.callback(server.join)
        stack.callback(stopped.set)
        yield {**os.environ, "PALPATE_HUB": str(path)}


def printed(command, environment):
    program, *arguments = shlex.split(command)
    assert program == "palpate-host"
    done = subprocess.run(
        [sys.executable, "-m", "palpate_host.cli.main", *arguments],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    return (
        "".join(line.rstrip() + "\n" for line in (done.stdout + done.stderr).splitlines()).strip("\n") + "\n"
    )


def pattern(text, loose):
    text = re.sub(r"\d+(\.\d+)?", "0", text) if loose else text
    return ".*".join(re.escape(part) for part in text.split("..."))


@pytest.fixture(scope="module")
def environment():
    with tempfile.TemporaryDirectory() as folder, live_bus(Path(folder)) as found:
        yield found


@pytest.mark.parametrize(("command", "output"), examples(), ids=lambda text: text[:60])
def test_the_page_shows_what_the_command_prints(environment, command, output):
    shown = printed(command, environment)
    loose = command.split()[1] in LOOSE
    shown = re.sub(r"\d+(\.\d+)?", "0", shown) if loose else shown
    assert re.fullmatch(pattern(output, loose), shown), (
        f"{shown}\nif meant: python tests/bus/cli/test_bus_page.py"
    )


def rewrite():
    with tempfile.TemporaryDirectory() as folder, live_bus(Path(folder)) as found:

        def again(match):
            short = "".join(
                line if len(line) <= 120 else line[:100].rstrip() + "...\n"
                for line in printed(match["command"], found).splitlines(keepends=True)
            )
            return f"```console\n$ {match['command']}\n{short}```"

        PAGE.write_text(BLOCK.sub(again, PAGE.read_text()))


if __name__ == "__main__":
    rewrite()
