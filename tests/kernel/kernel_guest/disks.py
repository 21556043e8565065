"""The virtual machine's disks, built once and kept in .cache/ of the project; needs no other library."""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

RECIPE = Path(__file__).with_name("vm")
PROJECT = Path(__file__).resolve().parents[3]
CACHE = PROJECT / ".cache" / "vm"
PYTHON = "3.11"  # bookworm's
PACKAGES_MB = 1200


def system_disk() -> Path:
    """Return the folder of root.ext4, vmlinuz and initrd.img; vm/build.sh builds it if it is missing."""
    recipe = b"".join(path.read_bytes() for path in sorted(RECIPE.iterdir()))
    target = CACHE / f"system-{digest(recipe)}"
    if not target.exists():
        with made(target) as folder:
            subprocess.run([RECIPE / "build.sh", folder], check=True)
    return target


def packages_disk() -> Path:
    """Return a disk with the Python packages of requirements/guest.lock for the machine's Python."""
    lock = PROJECT / "requirements" / "guest.lock"
    target = CACHE / f"packages-{digest(lock.read_bytes())}"
    if not target.exists():
        with made(target) as folder, tempfile.TemporaryDirectory(dir=folder) as tree:
            options = ("--quiet", "--disable-pip-version-check", "--only-binary=:all:", "--require-hashes")
            where = ("--target", tree, "--python-version", PYTHON)
            pip = [sys.executable, "-m", "pip", "install", *options, *where, "-r", lock]
            subprocess.run(pip, check=True)
            disk = ("-L", "packages", "-d", tree, folder / "packages.ext4", f"{PACKAGES_MB}M")
            subprocess.run(["/sbin/mke2fs", "-q", "-t", "ext4", *disk], check=True)
    return target / "packages.ext4"


@contextmanager
def made(target: Path) -> Iterator[Path]:
    """Yield a folder in which to build `target`: it appears complete or not at all."""
    print(f"building {target}: a few minutes, once", file=sys.stderr, flush=True)
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix="unfinished-") as folder:
        yield Path(folder)
        Path(folder).chmod(0o755)
        with suppress(OSError):  # another process was faster
            Path(folder).rename(target)
        Path(folder).mkdir(exist_ok=True)


def digest(content: bytes) -> str:
    """Return a digest that is short enough for a name."""
    return hashlib.sha256(content).hexdigest()[:16]


if __name__ == "__main__":
    print(system_disk(), packages_disk(), sep="\n")
