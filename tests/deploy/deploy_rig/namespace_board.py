"""A board without a kernel of its own: systemd as process 1 in namespaces, its files over bare Debian's."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

BOOT = Path(__file__).with_name("boot-namespace.sh")
PATIENCE_S = 60.0
FAILED = "d9b373ed55a64feb8242e02dbe79a49c"  # systemd's catalog: a unit has entered the failed state
# It ends with pytest, however that ends.
INTO_CGROUP = ("sh", "-c", 'echo $$ >"$0/cgroup.procs"; exec setpriv --pdeathsig KILL "$@"')
NAMESPACES = ("--mount", "--pid", "--fork", "--kill-child", "--uts", "--ipc", "--net", "--cgroup")


class NamespaceBoard:
    """folder: where it keeps what it writes; written/ is all that differs from the bare card. Its folder
    /run/outside is outside/ here: a Unix socket in there is a cable to the outside.

    layers: folders of files that its card had before, the newest first and bare Debian last.
    """

    def __init__(self, folder: Path, *layers: Path) -> None:
        self._lower, self.folder = ":".join(map(str, layers)), folder
        self.written, self.outside = folder / "written", folder / "outside"
        for name in ("written", "work", "root", "outside"):
            (folder / name).mkdir()
        self._cgroup = cgroup2() / f"palpate-board-{os.getpid()}-{folder.name}"
        self._first: subprocess.Popen[bytes] | None = None
        self._pid = 0

    def boot(self) -> None:
        """Returns when systemd has started all that it wants to start."""
        self._cgroup.mkdir(exist_ok=True)
        with (self.folder / "console").open("ab") as console:
            self._first = subprocess.Popen(
                [*INTO_CGROUP, self._cgroup, "unshare", *NAMESPACES, BOOT, self._lower, self.folder],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
            )
        end_s = time.monotonic() + PATIENCE_S
        while True:
            assert self._first.poll() is None, (self.folder / "console").read_text()
            assert time.monotonic() < end_s, f"no systemd: {(self.folder / 'console').read_text()}"
            children = Path(f"/proc/{self._first.pid}/task/{self._first.pid}/children").read_text().split()
            if children and Path(f"/proc/{children[0]}/comm").read_text().strip() == "systemd":
                self._pid = int(children[0])
                self._write_ssh()
                state = self.run("systemctl", "is-system-running", "--wait", check=False)
                if state in ("running", "degraded"):
                    return
            time.sleep(0.05)

    def run(self, *words: str | Path, check: bool = True) -> str:
        """A command on the board, as root."""
        command = ["nsenter", f"--target={self._pid}", "--all", "--wd=/", *words]
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        assert answer.returncode == 0 or not check, f"{words}: {answer.stdout}{answer.stderr}"
        return answer.stdout.strip()

    def failures(self, service: str) -> list[str]:
        """Return how each failure of the service since the start ended, from the log of process 1."""
        words = (f"UNIT={service}", "_PID=1", f"MESSAGE_ID={FAILED}", "--output-fields=UNIT_RESULT")
        lines = self.run("journalctl", "--quiet", "--output=json", *words).splitlines()
        return [json.loads(line)["UNIT_RESULT"] for line in lines]

    def begin(self, *words: str | Path) -> subprocess.Popen[bytes]:
        """A command on the board that is not waited for."""
        return subprocess.Popen(["nsenter", f"--target={self._pid}", "--all", *words])

    @property
    def ssh(self) -> dict[str, str]:
        """The inventory's words on how it is reached: on its own loopback, which nothing else is in."""
        return {
            "ansible_host": "127.0.0.1",
            "ansible_ssh_executable": str(self.folder / "ssh"),
            "ansible_ssh_transfer_method": "piped",
        }

    def processor_s(self) -> float:
        """Return the processor time of all its processes since its boot."""
        used = (self._cgroup / "cpu.stat").read_text().partition("usage_usec ")[2]
        return int(used.partition("\n")[0]) / 1e6

    def listing(self, tasks: Path) -> dict[str, str]:
        """Return the environment of callbacks/list_tasks.py, which lists a playbook's tasks in this file."""
        return {
            "PALPATE_TASKS": str(tasks),
            "PALPATE_WRITTEN": str(self.written),
            "PALPATE_FIRST": str(self._pid),
            "PALPATE_CGROUP": str(self._cgroup),
        }

    def power_cut(self) -> None:
        """Every process is gone at once; what it wrote stays."""
        if self._first is None:
            return
        if self._pid:
            with suppress(ProcessLookupError):
                os.kill(self._pid, signal.SIGKILL)
        self._first.kill()
        self._first.wait()
        self._first, self._pid = None, 0
        self._remove_cgroup()

    def keep_card(self, layer: Path) -> Path:
        """Cut the power and keep what the board wrote as a layer for other boards."""
        self.power_cut()
        return self.written.rename(layer)

    def as_disk(self, disk: Path) -> None:
        """Write the card of this board, which is off, as an ext4 file system."""
        layers = f"lowerdir={self._lower},upperdir={self.written},workdir={self.folder}/work"
        make = f"/sbin/mke2fs -q -t ext4 -d {self.folder}/root {disk} 4G"
        mount = f"mount -t overlay -o {layers} board {self.folder}/root"
        subprocess.run(["unshare", "--mount", "sh", "-ec", f"{mount}; {make}"], check=True)

    def files_written(self) -> dict[str, int]:
        """Path on the card -> time of its last change, ns: all that differs from bare Debian."""
        found = {}
        for folder, _, files in os.walk(self.written):
            for name in files:
                path = Path(folder, name)
                found[f"/{path.relative_to(self.written)}"] = path.lstat().st_mtime_ns
        return found

    def _write_ssh(self) -> None:
        program = self.folder / "ssh"
        program.write_text(f'#!/bin/sh\nexec nsenter --net=/proc/{self._pid}/ns/net ssh "$@"\n')
        program.chmod(0o755)

    def _remove_cgroup(self) -> None:
        end_s = time.monotonic() + PATIENCE_S
        groups = [Path(folder) for folder, _, _ in os.walk(self._cgroup, topdown=False)]
        for group in groups:
            while group.exists() and time.monotonic() < end_s:
                try:
                    group.rmdir()
                except OSError:  # its last process is not reaped yet
                    time.sleep(0.01)


@contextmanager
def namespace_board(
    folder: Path, *layers: Path, prepare: Callable[[NamespaceBoard], None] = lambda _: None
) -> Iterator[NamespaceBoard]:
    """A board that boots after `prepare`; gone, with its files, at the end."""
    folder.mkdir()
    board = NamespaceBoard(folder, *layers)
    try:
        prepare(board)
        board.boot()
        yield board
    finally:
        board.power_cut()
        shutil.rmtree(folder, ignore_errors=True)


def cgroup2() -> Path:
    for line in Path("/proc/mounts").read_text().splitlines():
        _, place, kind, *_ = line.split()
        if kind == "cgroup2":
            return Path(place)
    raise AssertionError("no cgroup2 file system is mounted: mount -t cgroup2 none /sys/fs/cgroup")
