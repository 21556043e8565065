"""A host and its boards as guests in user-mode Linux: each has a clock of its own, and they share a network.

A guest's kernel counts on a crystal with an error of its own (crystal.c). The cables are pairs of sockets
between the guests' virtual network cards, so that no packet reaches this machine's network.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from kernel_guest.user_mode import boot_command

RIG = Path(__file__).parent
HOST_ADDRESS = "10.9.255.1"  # each board reaches it by its own cable


@dataclass(frozen=True)
class ClockGuest:
    """One guest. chrony: configuration; crystal_ppm: its error; starts_at: for `date`."""

    name: str
    chrony: str
    crystal_ppm: float
    starts_at: str


class ClockGuests:
    """The running guests. folder: what they share with this machine."""

    def __init__(self, folder: Path, host: subprocess.Popen[bytes], boards: Sequence[ClockGuest]) -> None:
        self._folder, self._host, self._boards = folder, host, boards

    def offsets(self, board: str) -> list[dict[str, float]]:
        """Return the offsets of a board to the host so far, in the order of time (clock_exchange.py)."""
        number = [each.name for each in self._boards].index(board)
        file = self._folder / "host/offsets.jsonl"
        rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
        return [row for row in rows if row["board"] == _board_address(number)]

    def start_chrony(self) -> None:
        """Start chrony on the boards; on the host it runs from the beginning."""
        for note in self._folder.glob("*/stood-still"):
            note.unlink()
        for board in self._boards:
            (self._folder / board.name / "go").touch()

    def wait(self, patience_s: float) -> float:
        """Wait for the end of the exchange; return the longest time, s, that a guest stood still since
        `start_chrony`, 0 if none did for long."""
        self._host.wait(patience_s)
        notes = [note.read_text().split() for note in self._folder.glob("*/stood-still")]
        return max((float(still_s) for note in notes for still_s in note), default=0.0)


@contextmanager
def clock_guests(
    folder: Path, card: Sequence[Path], host: ClockGuest, boards: Sequence[ClockGuest], lasts_s: float
) -> Iterator[ClockGuests]:
    """Boot the guests on copies of a card (its layers, the newest first); the exchange lasts so long."""
    crystal = folder / "crystal.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", crystal, RIG / "crystal.c", "-ldl"], check=True)
    with ExitStack() as stack:
        cables = [socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM) for _ in boards]
        for end in (end for cable in cables for end in cable):
            stack.callback(end.close)

        def boot(
            guest: ClockGuest, ends: Sequence[socket.socket], commands: Sequence[str], task: object
        ) -> subprocess.Popen[bytes]:
            _share(folder / guest.name, card, guest, commands, task)
            return _boot(stack, folder / guest.name, guest, crystal, ends)

        for number, board in enumerate(boards):
            route = f"ip route add default via {_host_address(number)}"
            boot(board, [cables[number][1]], [*_link(0, _board_address(number)), route], {"addresses": []})
        commands = [f"ip address add {HOST_ADDRESS}/32 dev lo", "touch /run/shared/go"]
        for number in range(len(boards)):
            commands += _link(number, _host_address(number))
        task = {"addresses": [_board_address(number) for number in range(len(boards))], "lasts_s": lasts_s}
        yield ClockGuests(folder, boot(host, [cable[0] for cable in cables], commands, task), boards)


def _share(
    shared: Path, card: Sequence[Path], guest: ClockGuest, commands: Sequence[str], task: object
) -> None:
    """Fill the folder that a guest shares (clock-guest.sh)."""
    shared.mkdir()
    shutil.copy(RIG / "clock_exchange.py", shared)
    (shared / "palpate.conf").write_text(guest.chrony)
    (shared / "task.json").write_text(json.dumps(task))
    layers = f"layers={':'.join(map(str, card))}"
    lines = [layers, "begin() {", *commands, f"date --set '{guest.starts_at}'", "}"]
    (shared / "start.sh").write_text("\n".join(lines) + "\n")


def _boot(
    stack: ExitStack, shared: Path, guest: ClockGuest, crystal: Path, ends: Sequence[socket.socket]
) -> subprocess.Popen[bytes]:
    cards = [f"vec{number}:transport=fd,fd={end.fileno()}" for number, end in enumerate(ends)]
    machine = stack.enter_context(
        subprocess.Popen(
            [*boot_command(shared, RIG / "clock-guest.sh", crystal), *cards],
            stdin=subprocess.DEVNULL,
            stdout=stack.enter_context((shared / "console").open("wb")),
            stderr=subprocess.STDOUT,
            env={**os.environ, "CRYSTAL_PPM": str(guest.crystal_ppm)},
            pass_fds=[end.fileno() for end in ends],
        )
    )
    stack.callback(machine.terminate)
    return machine


def _link(card: int, address: str) -> list[str]:
    return [f"ip address add {address}/24 dev vec{card}", f"ip link set vec{card} up"]


def _board_address(number: int) -> str:
    return f"10.9.{number}.2"


def _host_address(number: int) -> str:
    return f"10.9.{number}.1"
