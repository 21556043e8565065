"""CANopenNode's programs on vcan0, where the hub may be bridged to it: a C stack, as master and as slave.

The programs are never part of this project: ``canopend`` of CANopenLinux is master and slave,
``demoLinuxDevice`` of CANopenDemo a slave with strings, a domain and PDOs. They are built from a checkout
(canopennode_build.py) or given as paths; else their names are looked up in PATH.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from kernel_guest.canopennode_build import CHECKOUT, VARIABLES
from kernel_guest.hub_bridge import OwnBus
from kernel_guest.links import PATIENCE_S, Link
from palpate_edge.can_bus.bus import Bus, open_bus
from palpate_edge.can_bus.can_frame import CanFrame

STORES = ("od_comm", "mainline", "od_app", "od_app_auto")
"""Files in which the programs store parameters."""

NOTHING_STORED = "-\n"
"""Content of such a file at first; a program without the file reports an error and is never OPERATIONAL."""

POLL_S = 0.02


def program(name: str) -> Path:
    """Return the path of one of CANopenNode's programs; skip the test where there is none."""
    found = shutil.which(os.environ.get(VARIABLES[name], name))
    if found is None:
        pytest.skip(
            f"{name} of CANopenNode is missing: set {CHECKOUT} to a checkout of CANopenDemo, or "
            f"{VARIABLES[name]} to the program"
        )
    return Path(found)


class ForeignNode:
    """A program of CANopenNode as a process on a CAN interface.

    node_id: 255 for none; None for the id that the program has stored in `folder`.
    """

    def __init__(self, name: str, link: Link, folder: Path, node_id: int | None, *options: str) -> None:
        path = program(name)
        folder.mkdir(exist_ok=True)
        for store in STORES:
            file = folder / f"{store}.persist"
            if not file.exists():
                file.write_text(NOTHING_STORED)
        self._log = folder / "log"
        number = () if node_id is None else ("-i", str(node_id))
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [path, link.name, *number, "-s", f"{folder}/", *options], stdout=log, stderr=log
            )
        end_s = time.monotonic() + PATIENCE_S
        while "running ..." not in self.log():
            assert time.monotonic() < end_s, self.log()
            time.sleep(POLL_S)

    def log(self) -> str:
        """Return what the program has written to its log."""
        return self._log.read_text()

    def stop(self) -> None:
        """End the process without a last message."""
        self.process.kill()
        self.process.wait()


class Gateway(ForeignNode):
    """``canopend`` as a master: node 1 with its command interface of CiA 309-3 on a local socket."""

    def __init__(self, link: Link, folder: Path) -> None:
        address = folder / "commands"
        super().__init__("canopend", link, folder, 1, "-c", f"local-{address}")
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(PATIENCE_S)
        self._socket.connect(str(address))
        self._lines = self._socket.makefile("rb")
        self._sequence = 0

    def ask(self, command: str) -> str:
        """Return the response to a command: ``OK``, a value or ``ERROR:`` with a code.

        Lines before it that start with # are comments; they are returned in front of it.
        """
        self._sequence += 1
        self._socket.sendall(f"[{self._sequence}] {command}\n".encode())
        prefix, lines = f"[{self._sequence}] ", []
        for line in self._lines:
            lines.append(line.decode().strip())
            if lines[-1].startswith(prefix):
                return "\n".join([*lines[:-1], lines[-1].removeprefix(prefix)])
        raise AssertionError(f"canopend ended:\n{self.log()}")

    def close(self) -> None:
        """Close the connection to the command interface."""
        self._lines.close()
        self._socket.close()


class Listener(threading.Thread):
    """Every frame that others send to `bus`, in order; a thread, since the kernel keeps a few hundred."""

    def __init__(self, bus: Bus) -> None:
        super().__init__()
        self.bus = bus
        self.frames: list[CanFrame] = []
        self._ends = threading.Event()

    def run(self) -> None:
        while not self._ends.is_set():
            self.frames += [frame for _, frame in self.bus.receive(0.05)]

    def wait_for(self, wanted: CanFrame, start: int = 0) -> int:
        """Wait for a frame that begins with the bytes of `wanted`; return the place after it in `frames`.

        start: place from which on it may be.
        """
        end_s = time.monotonic() + PATIENCE_S
        place = start
        while time.monotonic() < end_s:
            while place < len(self.frames):
                frame = self.frames[place]
                place += 1
                if frame.can_id == wanted.can_id and frame.data.startswith(wanted.data):
                    return place
            time.sleep(POLL_S)
        raise AssertionError(f"{wanted} is not among {len(self.frames) - start} frames")

    def stop(self) -> None:
        """Receive no more."""
        self._ends.set()
        self.join()


@pytest.fixture
def listener(own_bus: OwnBus) -> Iterator[Listener]:
    """Listen to the bus of palpate's programs."""
    with open_bus(own_bus.config, "listener") as bus:
        listener = Listener(bus)
        listener.start()
        yield listener
        listener.stop()


@pytest.fixture
def foreign_slave(vcan: Link, tmp_path: Path) -> Iterator[Callable[..., ForeignNode]]:
    """Start a slave on vcan0: `foreign_slave(node_id)`, or with the name of its program."""
    with ExitStack() as stack:

        def start(node_id: int | None, name: str = "demoLinuxDevice") -> ForeignNode:
            node = ForeignNode(name, vcan, tmp_path / "foreign", node_id)
            stack.callback(node.stop)
            return node

        yield start


@pytest.fixture
def gateway(vcan: Link, tmp_path: Path) -> Iterator[Gateway]:
    """Start canopend as the master on vcan0."""
    with closing(Gateway(vcan, tmp_path / "gateway")) as gateway:
        yield gateway
    gateway.stop()
