"""A board in user-mode Linux: a kernel of its own on a disk, with ssh and a virtual CAN bus, at full speed.

Its bus has a master on the board itself (witness.py), which prints what it sees to the console.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from deploy_rig.namespace_board import INTO_CGROUP, cgroup2
from kernel_guest.user_mode import wide_registers

RIG = Path(__file__).parent
ADDRESS, OUTSIDE = "10.9.0.2", "10.9.0.1"
NETWORK = f"""ip tuntap add tap0 mode tap; ip address add {OUTSIDE}/24 dev tap0
ip link set lo up; ip link set tap0 gso_max_segs 1; ip link set tap0 up; exec env "$@"
"""
MODULES = "/usr/lib/uml/modules"
PATIENCE_S = 900.0  # on a busy machine
LOG_BYTES = 8 << 30  # room for all writes; the file is sparse
CONTACT, WITNESS = "witness has a contact", "witness: "

BUS = f"""[Unit]
Description=can0 as a virtual bus, with the modules of the machine outside
Before=palpate-fingertip.service
[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=/bin/sh -ec 'mkdir -p /run/uml; mount -t hostfs -o {MODULES} none /run/uml; \\
  cd /run/uml/$(uname -r)/kernel; \\
  for each in net/can/can net/can/can-raw drivers/net/can/dev/can-dev drivers/net/can/vcan; \\
  do insmod $each.ko; done; \\
  ip link add can0 type vcan; ip link set can0 up'
[Install]
WantedBy=multi-user.target
"""
MASTER = """[Unit]
Requires=bus.service
After=bus.service
[Service]
ExecStart=/usr/local/sbin/witness
[Install]
WantedBy=multi-user.target
"""
HARDWARE = {
    "/etc/systemd/system/bus.service": BUS,
    "/etc/systemd/system/witness.service": MASTER,
    "/etc/systemd/system/palpate-fingertip.service.d/slow.conf": (
        "[Service]\nTimeoutStartSec=600s\nWatchdogSec=60s\nTimeoutStopSec=60s\n"
    ),
    "/etc/systemd/system.conf.d/zz-no-watchdog.conf": "[Manager]\nRuntimeWatchdogSec=0\n",
    "/etc/systemd/network/50-vector.network": f"[Match]\nName=vec*\n[Network]\nAddress={ADDRESS}/24\n",
    "/usr/local/sbin/witness": (RIG / "witness.py").read_text(),
}
"""Files that stand for hardware, and the master, on a card for this machine."""
SET_UP = "chmod 755 /usr/local/sbin/witness; systemctl enable bus witness; systemctl mask getty.target"


class UserModeBoard:
    """folder: of its console. It boots a disk, or a layer over a disk that keeps the disk unchanged."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._cgroup = cgroup2() / f"palpate-board-{os.getpid()}-{folder.name}"
        self._pressure = self._cgroup / "cpu.pressure"
        self._machine: subprocess.Popen[bytes] | None = None

    def boot(self, disk: Path) -> None:
        """Start from a disk."""
        self._start("root=/dev/ubda", "rw", f"ubd0={disk}")

    def boot_recorded(self, disk: Path, log: Path) -> None:
        """Start from a disk; the log gets every write to it and every flush (write_log.py)."""
        with log.open("wb") as file:
            file.truncate(LOG_BYTES)
        outside = ("root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro")
        self._start(*outside, f"ubd0={disk}", f"ubd1={log}", f"init={RIG}/record-writes.sh")

    def boot_layer(self, disk: Path) -> None:
        """Start from a disk that stays as it is."""
        layer = self.folder / "layer"
        layer.unlink(missing_ok=True)
        self._start("root=/dev/ubda", "rw", f"ubd0={layer},{disk}")

    def _start(self, *words: str) -> None:
        self._cgroup.mkdir(exist_ok=True)
        environment = [f"LD_PRELOAD={':'.join(map(str, wide_registers(self.folder)))}"]
        kernel = [
            *("linux.uml", "mem=1G", *words),
            *("con=null", "con0=null,fd:1", f"uml_dir={self.folder}/"),
            "vec0:transport=tap,ifname=tap0,depth=64",
        ]
        namespaces = ["unshare", "--net", "--pid", "--fork", "--kill-child"]
        network = ["sh", "-ec", NETWORK, "sh", *environment]
        with (self.folder / "console").open("wb") as console:
            self._machine = subprocess.Popen(
                [*INTO_CGROUP, self._cgroup, *namespaces, *network, *kernel],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
            )
        ssh = self.folder / "ssh"
        ssh.write_text(f'#!/bin/sh\nexec nsenter --net=/proc/{self._machine.pid}/ns/net ssh "$@"\n')
        ssh.chmod(0o755)

    @property
    def ssh(self) -> dict[str, str]:
        """The inventory's words on how it is reached."""
        return {
            "ansible_host": ADDRESS,
            "ansible_ssh_executable": str(self.folder / "ssh"),
            "ansible_ssh_transfer_method": "piped",
        }

    def witness(self) -> dict[str, Any]:
        """Return what witness.py prints at the first contact.

        waited_s: how long, until the contact, other programs of this machine had the processor.
        """
        end_s, waited_s = time.monotonic() + PATIENCE_S, None
        while True:
            assert self._machine is not None
            ended = self._machine.poll() is not None
            lines = (self.folder / "console").read_text(errors="replace").splitlines()
            if waited_s is None and any(CONTACT in line for line in lines):
                waited_s = self.waited_s()
            for line in lines:
                if WITNESS in line and line.rstrip().endswith("}"):
                    return {"waited_s": waited_s, **json.loads(line.partition(WITNESS)[2])}
            last = "\n".join(lines[-30:])
            assert not ended, f"the machine has ended: {last}"
            assert time.monotonic() < end_s, f"no contact in {PATIENCE_S} s: {last}"
            time.sleep(0.2)

    def waited_s(self) -> float:
        """Return how long no program of the machine had a processor though one wanted it."""
        full = next(line for line in self._pressure.read_text().splitlines() if line.startswith("full"))
        return int(full.rpartition("total=")[2]) / 1e6

    def power_cut(self) -> None:
        """End at once: what the kernel has not written is lost."""
        if self._machine is None:
            return
        with suppress(ProcessLookupError):
            self._machine.send_signal(signal.SIGKILL)
        self._machine.wait()
        self._machine = None
        (self.folder / "layer").unlink(missing_ok=True)
        (self._cgroup / "cgroup.kill").write_text("1")
        end_s = time.monotonic() + 60
        while self._cgroup.exists():
            with suppress(OSError):
                self._cgroup.rmdir()
            assert time.monotonic() < end_s
            time.sleep(0.02)
