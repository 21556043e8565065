"""CAN interfaces for the tests inside: a virtual one, and one with a cable that the test itself drains."""

from __future__ import annotations

import fcntl
import os
import pty
import struct
import subprocess
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from palpate_edge.can_bus.bus import Bus
from palpate_edge.can_bus.can_frame import CanFrame

N_SLCAN = 17  # linux/tty.h
PATIENCE_S = 120.0  # only a hang waits so long; an emulated machine beside other work is slow


def receive(bus: Bus, count: int) -> list[CanFrame]:
    """Return `count` frames from a bus; fail with the number received if fewer come."""
    frames: list[CanFrame] = []
    while len(frames) < count:
        batch = bus.receive(PATIENCE_S)
        assert batch, f"{len(frames)} of {count} frames arrived"
        frames += [frame for _, frame in batch]
    return frames


def ip(*words: object) -> None:
    """Run one command of iproute2: ip("link", "set", "vcan0", "up")."""
    subprocess.run(["ip", *map(str, words)], check=True)


class Link:
    """Create a network interface of the kernel."""

    def __init__(self, name: str) -> None:
        self.name = name

    def up(self) -> None:
        ip("link", "set", self.name, "up")

    def down(self) -> None:
        ip("link", "set", self.name, "down")

    def delete(self) -> None:
        ip("link", "delete", self.name)

    @property
    def exists(self) -> bool:
        return Path("/sys/class/net", self.name).exists()


class SerialLink(Link):
    """The kernel's slcan driver on a pseudo terminal: the test is the CAN controller at the other end.

    A frame whose text nobody reads waits in the driver, the next ones in the interface's transmit queue.
    """

    def __init__(self, txqueuelen: int) -> None:
        self._wire, self._terminal = pty.openpty()
        self._unread = b""
        tty.setraw(self._terminal)
        fcntl.ioctl(self._terminal, termios.TIOCSETD, struct.pack("i", N_SLCAN))
        name = fcntl.ioctl(self._terminal, 0x8910, bytes(16))  # SIOCGIFNAME
        super().__init__(name.rstrip(b"\0").decode())
        ip("link", "set", self.name, "txqueuelen", txqueuelen, "up")

    def read_lines(self, count: int) -> list[str]:
        """Return the next frames on the cable as slcan text: ``t`` id (3 digits) length data."""
        while self._unread.count(b"\r") < count:
            self._unread += os.read(self._wire, 32)
        *lines, self._unread = self._unread.split(b"\r", count)
        return [line.decode() for line in lines]

    def write(self, text: bytes) -> None:
        """Return the controller's output as slcan text."""
        os.write(self._wire, text)

    def close(self) -> None:
        os.close(self._wire)
        os.close(self._terminal)


@pytest.fixture
def vcan() -> Iterator[Link]:
    """Create vcan0 and set it up."""
    ip("link", "add", "vcan0", "type", "vcan")
    link = Link("vcan0")
    link.up()
    yield link
    if link.exists:
        link.delete()


@pytest.fixture
def fd_vcan(vcan: Link) -> Link:
    """Make room on vcan0 for the frames of CAN FD (CANFD_MTU)."""
    vcan.down()
    ip("link", "set", vcan.name, "mtu", 72)
    vcan.up()
    return vcan


@pytest.fixture
def serial_link() -> Iterator[SerialLink]:
    """A CAN interface with room for 10 frames, whose cable only the test reads."""
    link = SerialLink(txqueuelen=10)
    yield link
    link.close()


@pytest.fixture
def can_cards() -> Iterator[tuple[Link, Link]]:
    """Two CAN cards on one cable, up at 1 Mbit/s (virtual machine only)."""
    subprocess.run(["modprobe", "kvaser_pci"], check=True)
    cards = (Link("can0"), Link("can1"))
    for card in cards:
        ip("link", "set", card.name, "type", "can", "bitrate", 1_000_000)
        card.up()
    yield cards
    for card in cards:
        card.down()
