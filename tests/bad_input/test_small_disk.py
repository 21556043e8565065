"""Programs that write many files say in one line that the disk is full; on a disk of a few kilobytes."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

NO_SPACE = "no space left on the disk"


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 64 kB; the test is skipped where none can be mounted."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no tmpfs can be mounted here: run as root")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@pytest.mark.parametrize(
    "command",
    [
        ["demo", "--lockstep", "--duration", "2", "--no-view", "--output", "out"],
        ["simulate", "dataset", "--presses", "20", "--test-presses", "0", "-o", "out"],
        ["simulate", "fingertips", "-o", "out"],
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_a_full_disk_is_one_line(small_disk: Path, command: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "palpate_host.cli.main", *command],
        cwd=small_disk,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode not in (0, 120), done.stdout
    assert "Traceback" not in done.stderr
    last = done.stderr.splitlines()[-1]
    assert last.startswith("error: "), done.stderr
    assert NO_SPACE in last
