"""User-mode Linux: Debian's kernel as a process, on a read-only view of this machine's own files.

No image, no root and no KVM: the Python outside is the Python inside. It brings SocketCAN (vcan, slcan),
network namespaces and I2C stubs; it has no V4L2.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from kernel_guest.run import Inside

INIT = Path(__file__).with_name("user-mode-init.sh")
SHARED = Path("/run/shared")  # where the init mounts the shared folder
TEMPORARY = "/run/tmp"
WIDE_REGISTERS = Path(__file__).with_name("wide_registers.c")


class UserModeLinux:
    """User-mode Linux as a `Machine`."""

    name = "user-mode-linux"
    limit_s = 1200.0  # with --effort=full; a hang in it costs this much

    def missing(self) -> str | None:
        for tool, package in (("linux.uml", self.name), ("ip", "iproute2"), ("insmod", "kmod")):
            if shutil.which(tool, path=_search_path()) is None:
                return f"{package} is missing: make system-deps"
        if _has_wide_registers() and shutil.which("cc") is None:
            return "gcc is missing: make system-deps"
        return None

    def inside(self, project: Path, folder: Path) -> Inside:  # noqa: ARG002 - files are where they are outside
        environment = {
            "PATH": _search_path(),
            "HOME": TEMPORARY,
            "TMPDIR": TEMPORARY,
            "PYTHONPATH": os.environ.get("PYTHONPATH", ""),
            "HYPOTHESIS_STORAGE_DIRECTORY": f"{TEMPORARY}/hypothesis",
        }
        return Inside(project, SHARED, Path(sys.executable), environment)

    def command(self, folder: Path) -> list[str]:
        return boot_command(folder, INIT)


def boot_command(folder: Path, init: Path, *libraries: Path) -> list[str]:
    """Return the command that boots a guest with this first process. folder: what the guest shares.

    libraries: preloaded in the guest's kernel.
    """
    preloaded = [*libraries, *wide_registers(folder)]
    return [
        *(["env", f"LD_PRELOAD={':'.join(map(str, preloaded))}"] if preloaded else []),
        "linux.uml",
        "mem=2G",  # an upper bound; the kernel allocates only the memory it uses
        *("root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro"),
        *(f"init={init}", f"SHARED={folder}"),  # unknown parameters become init's environment
        *("quiet", "con=null", "con0=null,fd:1"),
        f"uml_dir={folder}/",
    ]


def _has_wide_registers() -> bool:
    return "amx_tile" in Path("/proc/cpuinfo").read_text(encoding="utf-8")


def wide_registers(folder: Path) -> list[Path]:
    """Return the library with which it starts on a processor with wide registers (wide_registers.c)."""
    if not _has_wide_registers():
        return []
    library = folder / "wide_registers.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", library, WIDE_REGISTERS, "-ldl"], check=True)
    return [library]


def _search_path() -> str:
    return f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/sbin"
