"""A board with a kernel: a virtual machine with its own disk, camera and CAN card, and ssh on loopback.

Its CAN bus has two ends: can0 is the board's own card, the other end is brought out over a serial line, as
slcan, to a socket on the loopback of the outside.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from deploy_rig.playbooks import SSH
from kernel_guest.virtual_machine import BOOT_OPTIONS

PATIENCE_S = 600.0  # an emulated machine among many programs


class BootedBoard:
    """With the kernel and the key of the folder `image`, from the card `folder`/disk."""

    def __init__(self, image: Path, folder: Path) -> None:
        self._image, self.folder = image, folder
        self.ssh_port, self.bus_port = _free_port(), _free_port()
        self._machine: subprocess.Popen[bytes] | None = None

    def boot(self) -> None:
        """Returns when ssh answers.

        Emulated kernels sometimes end in their own initialisation, before they read the card: such a start
        is repeated once.
        """
        console = self.folder / "console"
        before = console.stat().st_size if console.exists() else 0
        self._start()
        try:
            self._wait_for_ssh()
        except AssertionError:
            said = console.read_bytes()[before:]
            if b"not syncing: Fatal exception" not in said or b"kernel_init_freeable" not in said:
                raise
            print("the emulated kernel ended before it read the card: started again")
            self.power_cut()
            self._start()
            self._wait_for_ssh()

    def _wait_for_ssh(self) -> None:
        self.wait_for(lambda: self.run("true", check=False, patience_s=30) is not None)

    def _start(self) -> None:
        append = f"{BOOT_OPTIONS} net.ifnames=0"
        network = f"user,id=wire,restrict=on,hostfwd=tcp:127.0.0.1:{self.ssh_port}-:22"
        bus = f"socket,id=bus,host=127.0.0.1,port={self.bus_port},server=on,wait=off"
        cards = [word for port in ("a", "b") for word in ("-device", f"kvaser_pci,canbus=cable,id={port}")]
        command = [
            *("nice", "-n", "5", "qemu-system-x86_64", "-nodefaults", "-no-reboot", "-nographic"),
            *("-accel", "tcg", "-cpu", "Nehalem", "-smp", "2", "-m", "1536"),
            *("-kernel", self._image / "vmlinuz", "-initrd", self._image / "initrd.img", "-append", append),
            *("-drive", f"file={self.folder}/disk,format=raw,if=virtio"),
            *("-netdev", network, "-device", "virtio-net-pci,netdev=wire"),
            *("-serial", "stdio", "-device", "virtio-rng-pci"),
            *("-object", "can-bus,id=cable", *cards),
            *("-device", "virtio-serial", "-chardev", bus, "-device", "virtconsole,chardev=bus"),
        ]
        with (self.folder / "console").open("ab") as console:
            self._machine = subprocess.Popen(
                ["setpriv", "--pdeathsig", "KILL", *command],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
            )

    def wait_for(self, condition: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
        """Until it holds."""
        end_s = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < end_s, self.last_words()
            assert self._machine is not None and self._machine.poll() is None, self.last_words()
            time.sleep(0.5)

    def last_words(self) -> str:
        return (self.folder / "console").read_text(errors="replace")[-3000:]

    def run(self, *words: str, check: bool = True, patience_s: float = PATIENCE_S) -> str | None:
        """A command on the board, as root; None where it fails and may."""
        end_s = time.monotonic() + patience_s
        command = ["ssh", *self._ssh(), *words]
        try:
            answer = subprocess.run(
                command,
                capture_output=True,
                text=True,
                timeout=patience_s,
                stdin=subprocess.DEVNULL,
                check=False,
            )
        except subprocess.TimeoutExpired:
            assert not check, f"{words}: no answer in {patience_s} s: {self.last_words()}"
            return None
        if "during banner exchange" in answer.stderr and time.monotonic() < end_s:
            return self.run(
                *words, check=check, patience_s=end_s - time.monotonic()
            )  # it was too busy to answer
        if answer.returncode != 0:
            assert not check, f"{words}: {answer.stdout}{answer.stderr}"
            return None
        return answer.stdout.strip()

    def _ssh(self) -> list[str | Path]:
        key = self._image / "key"
        return [
            *SSH.split(),
            "-i",
            key,
            "-p",
            str(self.ssh_port),
            "-o",
            "ConnectTimeout=20",
            "root@127.0.0.1",
        ]

    def join_bus(self) -> None:
        """Bring the other end of the board's bus out to bus_port, once a boot."""
        self.run(
            "test -e /sys/class/net/slcan0 || { "
            "modprobe -a slcan can-gw && ip link set can1 type can bitrate 1000000 && ip link set can1 up && "
            "slcand -o -s8 hvc0 slcan0 && sleep 2 && ip link set slcan0 txqueuelen 1000 up && "
            "cangw -A -s can1 -d slcan0 -e && cangw -A -s slcan0 -d can1 -e; }"
        )

    def power_cut(self) -> None:
        """As if its plug were pulled."""
        if self._machine is not None:
            self._machine.send_signal(signal.SIGKILL)
            self._machine.wait()
            self._machine = None


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port: int = one.getsockname()[1]
        return port


@contextmanager
def booted_board(image: Path, folder: Path) -> Iterator[BootedBoard]:
    """A booted board; off at the end."""
    board = BootedBoard(image, folder)
    try:
        board.boot()
        yield board
    finally:
        board.power_cut()
