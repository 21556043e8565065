"""The library of the kernels: for each machine, from these sources, without a C library."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from palpate_edge.common.errors import KernelsError
from palpate_edge.kernels import library

ROOT = Path(__file__).resolve().parents[3]
MACHINES = {"x86_64": 62, "x86_64_v3": 62, "aarch64": 183}  # e_machine of the ELF header (System V ABI)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A copy of the library and its sources, which is loaded in place of them."""
    folder = tmp_path / "kernels"
    shutil.copytree(library.FOLDER, folder, ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    monkeypatch.setattr(library, "FOLDER", folder)
    library._library.cache_clear()
    yield folder
    library._library.cache_clear()


@pytest.mark.parametrize("machine", MACHINES)
def test_there_is_a_library_for_each_machine(machine):
    header = (library.FOLDER / library.BUILT / f"{machine}.so").read_bytes()[:64]
    assert header[:4] == b"\x7fELF"
    assert int.from_bytes(header[18:20], "little") == MACHINES[machine]
    assert b"libc" not in (library.FOLDER / library.BUILT / f"{machine}.so").read_bytes()


def test_the_same_sources_give_the_same_bytes(tmp_path):
    kernels = tmp_path / "edge" / "palpate_edge" / "kernels"
    shutil.copytree(library.FOLDER, kernels, ignore=shutil.ignore_patterns(library.BUILT, "__pycache__"))
    shutil.copy(ROOT / "hatch_build.py", tmp_path)
    subprocess.run([sys.executable, tmp_path / "hatch_build.py"], check=True, capture_output=True)
    for machine in MACHINES:
        made = (kernels / library.BUILT / f"{machine}.so").read_bytes()
        assert made == (library.FOLDER / library.BUILT / f"{machine}.so").read_bytes()


def test_a_machine_without_a_library_is_named(folder, monkeypatch):
    monkeypatch.setattr(library, "machine", lambda: "riscv64")
    with pytest.raises(
        KernelsError, match=r"missing for riscv64 \(they are there for aarch64, x86_64, x86_64_v3\)"
    ):
        library.kernel("kernels_checksum")


def test_a_library_of_another_kind_is_refused(folder):
    """As for a Python of 32 bits on a kernel of 64."""
    (folder / library.BUILT / f"{library.machine()}.so").write_bytes(b"\x7fELF\x01" + bytes(60))
    with pytest.raises(KernelsError, match="needs a 64-bit Python"):
        library.kernel("kernels_checksum")


def test_a_library_of_other_sources_is_refused(folder):
    source = folder / "library.c"
    source.write_text(source.read_text() + "\n/* changed */\n")
    with pytest.raises(KernelsError, match=r"not those of its sources: run python hatch_build.py"):
        library.kernel("kernels_checksum")


@pytest.mark.parametrize("array", [np.zeros(4, np.float64), np.zeros((4, 4), np.float32)[:, ::2]])
def test_an_array_of_another_kind_is_refused(array):
    with pytest.raises(TypeError, match="needs contiguous float32"):
        library.address(array, np.float32)
