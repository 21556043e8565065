"""The host's process on CAN interfaces, with simulated drives and fingertips: lost and found again.

On CAN FD each finger has one drive node with three axes.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import pytest
from tests.host.axes_hand import MBIT_5, axes_text

import palpate_host
from kernel_guest.links import PATIENCE_S, Link, ip
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_host import Hand
from palpate_host.common.command import CommandError
from palpate_host.common.mode import STOPPED, Mode
from palpate_host.operator.session import HandStoppedError

# In user-mode Linux alone: a whole hand is too much for a machine that is emulated.
UML = pytest.param("uml", marks=pytest.mark.uml)
pytestmark = [pytest.mark.usefixtures("kernel"), pytest.mark.parametrize("kernel", [UML], indirect=True)]

CLI = [sys.executable, "-m", "palpate_host.cli.main"]
DRIVES = [sys.executable, "-c", "from palpate_twin.cli.drives import drives; drives()"]
"""In the virtual machine nothing is installed, so palpate-host finds no commands by entry point."""
TIPS = Path(__file__).parents[1] / "host" / "touching_fingertips.py"
TABLE_4 = Path(palpate_host.__file__).parent / "models" / "table4.toml"
# Tick and time limits for a kernel that runs as a process on a loaded machine.
SLOWER = {
    "tick_Hz = 100": "tick_Hz = 25",
    "freeze_ms = 250": "freeze_ms = 5000",
    "hold_ms = 1000": "hold_ms = 10000",
    "joint_stop_ms = 100": "joint_stop_ms = 5000",
    "heartbeat_timeout_ms = 500": "heartbeat_timeout_ms = 10000",
    "\nstop_ms = 3000": "\nstop_ms = 20000",
    'interface = "palpate"': 'interface = "socketcan"\nchannel = "vcan0"',
    'start = "auto"': 'start = "command"',
}


class HandOnCan:
    """A host, nine drives and three fingertips on vcan0, each a process."""

    def __init__(
        self, folder: Path, stack: ExitStack, changed: Callable[[str], str] = lambda text: text
    ) -> None:
        """changed: makes another hand of Table 4's file."""
        self._folder, self._stack = folder, stack
        text = TABLE_4.read_text().replace('start = "command"', 'start = "auto"')
        for usual, patient in SLOWER.items():
            assert usual in text
            text = text.replace(usual, patient)
        self.config, self.socket = folder / "hand.toml", folder / "host.sock"
        self.config.write_text(changed(text))
        self.put_nodes_on_the_bus()
        self.host = self._start("host", *CLI, "run", "--config", self.config, "--socket", self.socket)

    def put_nodes_on_the_bus(self) -> None:
        """Restart drives and fingertips, whose programs end when their bus is lost."""
        self._start("drives", *DRIVES, "--config", self.config)
        self._start("fingertips", sys.executable, TIPS, self.config)

    def said(self) -> str:
        return (self._folder / "host.said").read_text()

    def _start(self, name: str, *command: object) -> subprocess.Popen[bytes]:
        with (self._folder / f"{name}.said").open("ab") as said:
            process = subprocess.Popen([*map(str, command)], stdout=said, stderr=said)
        self._stack.callback(process.wait)
        self._stack.callback(process.kill)
        return process


@pytest.fixture
def hand_on_can(vcan, tmp_path):
    with ExitStack() as stack:
        yield HandOnCan(tmp_path, stack)


@pytest.fixture
def axes_on_can(fd_vcan, tmp_path):
    """A finger's drives are axes of one node; contacts and drives send CAN FD frames."""
    with ExitStack() as stack:
        yield HandOnCan(tmp_path, stack, axes_text)


@pytest.fixture
def hand(hand_on_can, wait_until):
    wait_until(hand_on_can.socket.exists)
    with Hand(hand_on_can.socket) as hand:
        hand.status()  # its bus is open by then
        yield hand


def grasp(hand, wait_until):
    """Recover from any mode: a host without processor time for 200 ms is stopped by the drives' watchdogs."""

    def grasped():
        try:
            if hand.status().mode in STOPPED:
                hand.recover(PATIENCE_S)
            return hand.grasp(PATIENCE_S).mode is Mode.GRASP
        except (CommandError, HandStoppedError):
            return False

    wait_until(grasped)


def test_down_and_up_again(vcan, hand_on_can, hand, wait_until):
    grasp(hand, wait_until)
    vcan.down()
    wait_until(lambda: hand.status().mode is Mode.FAULT)
    wait_until(lambda: "the bus is down" in hand_on_can.said())
    with pytest.raises(CommandError, match="the bus is lost"):
        hand.recover()
    ticks = hand.status().counters.ticks
    wait_until(lambda: hand.status().counters.ticks > ticks + 60)  # longer than the longest pause
    vcan.up()
    hand_on_can.put_nodes_on_the_bus()
    wait_until(lambda: "the bus is up again" in hand_on_can.said())
    frames = hand.status().counters.frames_out
    wait_until(lambda: hand.status().counters.frames_out > frames)
    assert hand.status().mode is Mode.FAULT
    grasp(hand, wait_until)
    hand_on_can.host.terminate()
    assert hand_on_can.host.wait(PATIENCE_S) == 0


def test_an_interface_that_is_removed_and_made_again(vcan, hand_on_can, hand, wait_until):
    grasp(hand, wait_until)
    vcan.delete()
    wait_until(lambda: "the bus is down" in hand_on_can.said())
    ip("link", "add", vcan.name, "type", "vcan")
    Link(vcan.name).up()
    hand_on_can.put_nodes_on_the_bus()
    wait_until(lambda: "the bus is up again" in hand_on_can.said())
    grasp(hand, wait_until)


def test_told_to_stop_while_the_bus_is_away_it_ends_at_once_and_cleanly(vcan, hand_on_can, hand, wait_until):
    vcan.down()
    wait_until(lambda: hand.status().mode is Mode.FAULT)
    hand_on_can.host.terminate()
    assert hand_on_can.host.wait(PATIENCE_S) == 0
    assert not hand_on_can.socket.exists()


def test_axes_of_three_nodes_grasp_on_can_fd(fd_vcan, axes_on_can, wait_until):
    """In each tick a node sends one frame of its three axes, and takes one."""
    wait_until(axes_on_can.socket.exists)
    with (
        Hand(axes_on_can.socket) as hand,
        open_bus(BusConfig(channel=fd_vcan.name, data_bitrate=MBIT_5), "listener") as bus,
    ):
        grasp(hand, wait_until)
        seen = set()

        def all_seen():
            frames = [frame for _, frame in bus.receive(PATIENCE_S)]
            seen.update((frame.can_id, len(frame.data)) for frame in frames if frame.fd)
            return seen >= {(0x180 + node, 48) for node in (1, 2, 3)} | {(0x200 + n, 12) for n in (1, 2, 3)}

        wait_until(all_seen)
        assert {can_id >> 7 for can_id, _ in seen} == {0x180 >> 7, 0x200 >> 7, 0x400 >> 7}
    axes_on_can.host.terminate()
    assert axes_on_can.host.wait(PATIENCE_S) == 0
