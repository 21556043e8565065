"""The tests of the kernels once more, with kernels that stop at any access outside an array (GCC)."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from palpate_edge.kernels import library

HERE = Path(__file__).parent
RUN = """
import sys
from pathlib import Path
import pytest
from palpate_edge.kernels import library
library.FOLDER = Path(sys.argv[1])
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *sys.argv[2:]]))
"""
OPTIONS = "-std=c11 -O1 -g -fPIC -shared -ffreestanding -fno-math-errno -fsanitize=address,undefined"


@pytest.fixture
def sanitized(tmp_path: Path) -> Path:
    """A folder with the kernels, compiled with checks of every access."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed: make system-deps")
    sources = [path for path in library.FOLDER.iterdir() if path.suffix in (".c", ".h")]
    for path in sources:
        shutil.copy(path, tmp_path)
    code = [path for path in sources if path.suffix == ".c"]
    checksum = f"-DKERNELS_CHECKSUM={library.checksum(library.FOLDER)}u"
    made = tmp_path / library.BUILT / f"{library.machine()}.so"
    made.parent.mkdir()
    subprocess.run(["gcc", *OPTIONS.split(), "-Wno-psabi", checksum, "-o", made, *code], check=True)
    return tmp_path


def test_no_kernel_reads_or_writes_outside_its_arrays(sanitized: Path) -> None:
    runtime = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        for name in ("libasan.so", "libubsan.so")
    ]
    environment = os.environ | {
        "LD_PRELOAD": " ".join(path.strip() for path in runtime),
        "ASAN_OPTIONS": "detect_leaks=0:halt_on_error=1",
        "UBSAN_OPTIONS": "halt_on_error=1:print_stacktrace=1",
    }
    tests = sorted(HERE.glob("test_*.py"))
    chosen = [path for path in tests if path.name not in (Path(__file__).name, "test_library.py")]
    done = subprocess.run(
        [sys.executable, "-c", RUN, sanitized, *chosen],
        env=environment,
        cwd=HERE.parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    assert " passed" in done.stdout
