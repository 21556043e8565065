"""A virtual machine with Debian's own kernel and systemd: V4L2 (vivid), CAN cards (kvaser_pci), a watchdog.

qemu emulates it, which needs no KVM and computes ten times slower than the processor. Its disks are built
once and kept in .cache/ of the project; a boot never changes them.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from kernel_guest.run import Inside

RECIPE = Path(__file__).with_name("vm")
PROJECT = Path(__file__).resolve().parents[3]
CACHE = PROJECT / ".cache" / "vm"
PYTHON = "3.11"  # bookworm's
PACKAGES_MB = 1200

TOOLS = (
    ("qemu-system-x86_64", "qemu-system-x86"),
    ("mmdebstrap", "mmdebstrap"),
    ("mke2fs", "e2fsprogs"),
)


class VirtualMachine:
    """A `Machine`."""

    name = "virtual-machine"
    limit_s = 1500.0

    def missing(self) -> str | None:
        if platform.machine() != "x86_64":
            return "the virtual machine's disks are built on x86-64 only"
        for tool, package in TOOLS:
            if shutil.which(tool, path=f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/sbin") is None:
                return f"{package} is missing: make system-deps"
        return None

    def inside(self, project: Path, folder: Path) -> Inside:  # noqa: ARG002 - shared under a fixed name
        system_disk()
        packages_disk()
        environment = {
            "PYTHONPATH": "/run/project/edge:/run/project/host:/run/packages",
            "HYPOTHESIS_STORAGE_DIRECTORY": "/tmp/hypothesis",
        }
        return Inside(Path("/run/project"), Path("/run/shared"), Path("/usr/bin/python3"), environment)

    def command(self, folder: Path) -> list[str]:
        system = system_disk()
        share = "local,security_model=none"
        can_card = [word for port in ("a", "b") for word in ("-device", f"kvaser_pci,canbus=cable,id={port}")]
        return [
            *("nice", "-n", "10", "qemu-system-x86_64", "-nodefaults", "-no-reboot", "-nographic"),
            *("-accel", "tcg", "-cpu", "Nehalem", "-smp", "1", "-m", "1024"),
            *("-kernel", f"{system}/vmlinuz", "-initrd", f"{system}/initrd.img"),
            *("-append", "root=/dev/vda rw console=ttyS0 quiet panic=-1"),
            *("-drive", f"file={system}/root.ext4,format=raw,if=virtio,snapshot=on"),
            *("-drive", f"file={packages_disk()},format=raw,if=virtio,readonly=on"),
            *("-virtfs", f"{share},path={PROJECT},mount_tag=project,readonly=on"),
            *("-virtfs", f"{share},path={folder},mount_tag=shared"),
            *("-serial", "stdio", "-device", "virtio-rng-pci"),
            *("-object", "can-bus,id=cable", *can_card),
            *("-device", "i6300esb", "-action", "watchdog=reset"),
        ]


def system_disk() -> Path:
    """The folder of root.ext4, vmlinuz and initrd.img as vm/build.sh makes them; built if it is not there."""
    recipe = b"".join(path.read_bytes() for path in sorted(RECIPE.iterdir()))
    target = CACHE / f"system-{_digest(recipe)}"
    if not target.exists():
        with _made(target) as folder:
            subprocess.run([RECIPE / "build.sh", folder], check=True)
    return target


def packages_disk() -> Path:
    """A disk with the Python packages of requirements/guest.lock for the machine's Python."""
    lock = PROJECT / "requirements" / "guest.lock"
    target = CACHE / f"packages-{_digest(lock.read_bytes())}"
    if not target.exists():
        with _made(target) as folder, tempfile.TemporaryDirectory(dir=folder) as tree:
            options = ("--quiet", "--disable-pip-version-check", "--only-binary=:all:", "--require-hashes")
            where = ("--target", tree, "--python-version", PYTHON)
            pip = [sys.executable, "-m", "pip", "install", *options, *where, "-r", lock]
            subprocess.run(pip, check=True)
            disk = ("-L", "packages", "-d", tree, folder / "packages.ext4", f"{PACKAGES_MB}M")
            subprocess.run(["/sbin/mke2fs", "-q", "-t", "ext4", *disk], check=True)
    return target / "packages.ext4"


@contextmanager
def _made(target: Path) -> Iterator[Path]:
    """A folder to make `target` in: it appears whole or not at all."""
    print(f"building {target}: a few minutes, once", file=sys.stderr, flush=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="unfinished-") as folder:
        yield Path(folder)
        Path(folder).chmod(0o755)
        with suppress(OSError):  # another process was faster
            Path(folder).rename(target)
        Path(folder).mkdir(exist_ok=True)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


if __name__ == "__main__":
    print(system_disk(), packages_disk(), sep="\n")
