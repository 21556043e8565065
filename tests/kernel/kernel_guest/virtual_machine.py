"""A virtual machine with Debian's own kernel and systemd: V4L2 (vivid), CAN cards (kvaser_pci), a watchdog.

qemu emulates it, which needs no KVM and computes ten times slower than the processor. A boot never changes
its disks.
"""

from __future__ import annotations

import os
import platform
import shutil
from pathlib import Path

from kernel_guest.disks import PROJECT, packages_disk, system_disk
from kernel_guest.run import Inside

TOOLS = (
    ("qemu-system-x86_64", "qemu-system-x86"),
    ("mmdebstrap", "mmdebstrap"),
    ("mke2fs", "e2fsprogs"),
)

# An emulated processor does not speculate: the kernel's mitigations would cost a third of a program's start.
BOOT_OPTIONS = "root=/dev/vda rw console=ttyS0 quiet panic=-1 mitigations=off"


class VirtualMachine:
    """The virtual machine as a `Machine`."""

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
            *("-append", BOOT_OPTIONS),
            *("-drive", f"file={system}/root.ext4,format=raw,if=virtio,snapshot=on"),
            *("-drive", f"file={packages_disk()},format=raw,if=virtio,readonly=on"),
            *("-virtfs", f"{share},path={PROJECT},mount_tag=project,readonly=on"),
            *("-virtfs", f"{share},path={folder},mount_tag=shared"),
            *("-serial", "stdio", "-device", "virtio-rng-pci"),
            *("-object", "can-bus,id=cable", *can_card),
            *("-device", "i6300esb", "-action", "watchdog=reset"),
        ]
