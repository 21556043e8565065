"""A kernel that mounts a disk again and again, each time as the disk is then: user-mode Linux."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from kernel_guest.user_mode import boot_command

INIT = Path(__file__).with_name("mount-cards.sh")
PATIENCE_S = 300.0  # on a busy machine
ANSWER, DAMAGED = "witness: ", "EXT4-fs error"


class MountingKernel:
    """folder: of its console and of the layer that takes what is written to the disk."""

    def __init__(self, folder: Path, disk: Path) -> None:
        self._console, self._layer = folder / "console", folder / "layer"
        self._command = [
            *("setpriv", "--pdeathsig", "KILL", "unshare", "--pid", "--fork", "--kill-child"),
            *(*boot_command(folder, INIT), f"ubd0={self._layer},{disk}", "con0=fd:0,fd:1"),
        ]
        self._machine: subprocess.Popen[bytes] | None = None

    def card(self) -> dict[str, Any]:
        """Return what the witness prints of the disk, which stays as it is.

        The only key is `fault` where the disk cannot be mounted, is damaged, or the witness prints nothing.
        """
        if self._machine is None:
            self._boot()
        assert self._machine is not None and self._machine.stdin is not None
        self._layer.unlink(missing_ok=True)  # the kernel makes an empty one when it opens the disk
        begin = self._console.stat().st_size
        self._machine.stdin.write(b"\n")
        self._machine.stdin.flush()
        answer = self._wait_for(ANSWER, begin)
        said = self._said(begin)
        if answer is None or not answer.endswith("}") or DAMAGED in said:
            self.close()
            return {"fault": said[-3000:]}
        card: dict[str, Any] = json.loads(answer)
        return card

    def close(self) -> None:
        """End the kernel."""
        if self._machine is not None:
            self._machine.kill()
            self._machine.communicate()
            self._machine = None

    def _boot(self) -> None:
        with self._console.open("wb") as console:
            self._machine = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=console, stderr=console
            )
        assert self._wait_for("witness waits", 0) == "", self._said(0)

    def _wait_for(self, words: str, begin: int) -> str | None:
        """Return what follows these words on a whole line; None if the kernel ends or no such line comes."""
        assert self._machine is not None
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            ended = self._machine.poll() is not None
            for line in self._said(begin).splitlines(keepends=True):
                if words in line and line.endswith("\n"):
                    return line.partition(words)[2].strip()
            if ended:
                return None
            time.sleep(0.02)
        return None

    def _said(self, begin: int) -> str:
        return self._console.read_bytes()[begin:].decode(errors="replace")


@contextmanager
def mounting_kernel(folder: Path, disk: Path) -> Iterator[MountingKernel]:
    """A kernel for this disk; it ends with the context."""
    kernel = MountingKernel(folder, disk)
    try:
        yield kernel
    finally:
        kernel.close()
