"""Debian's Python for aarch64 with the wheels that a board installs, run by an emulator on this machine."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from deploy_rig.image import PROJECT, foreign_python, wheelhouse

EMULATOR = "qemu-aarch64-static"
COUNTING_EMULATOR = "qemu-aarch64"  # a static one loads no plug-in
PLUGIN = Path(__file__).with_name("count_instructions.c")


@dataclass(frozen=True)
class ForeignPython:
    """Runs programs. packages: folder of the installed wheels; tree: Debian's files."""

    tree: Path
    packages: Path
    version: str

    def run(self, *words: str | Path) -> str:
        """Return what a Python program prints."""
        begin_s = time.monotonic()
        command = [EMULATOR, *self._python("PYTHONDONTWRITEBYTECODE=1"), *words]
        answer = subprocess.run(command, capture_output=True, text=True, check=False)
        assert answer.returncode == 0, answer.stderr
        print(f"{str(words[1])[:30].strip()}: {time.monotonic() - begin_s:.1f} s under emulation")
        return answer.stdout

    def counter(self, folder: Path) -> InstructionCounter:
        """Return a counter of a program's instructions. folder: keeps compiled modules and the plug-in."""
        variables = ("PYTHONHASHSEED=0", "OPENBLAS_NUM_THREADS=1", f"PYTHONPYCACHEPREFIX={folder}/compiled")
        return InstructionCounter(instruction_plugin(folder), self._python(*variables))

    def _python(self, *variables: str) -> list[str | Path]:
        """Return the emulator's words for this Python, which imports the packages and bench/."""
        environment = (f"PYTHONPATH={self.packages}:{PROJECT}", *variables)
        words = [word for variable in environment for word in ("-E", variable)]
        return ["-cpu", "cortex-a53", "-L", self.tree, *words, self.tree / f"usr/bin/python{self.version}"]


@dataclass(frozen=True)
class InstructionCounter:
    """Counts the instructions of programs on aarch64. program: the emulator's words before the program's."""

    plugin: Path
    program: list[str | Path]

    def __call__(self, *words: str | Path) -> int:
        """Return the instructions of the second of two runs: its modules are compiled, as on a board."""
        environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        for _ in range(2):
            count = counted(self.plugin, *self.program, *words, environment=environment)
        return count


def instruction_plugin(folder: Path) -> Path:
    """Compile the plug-in."""
    library = folder / "count_instructions.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O2", "-o", library, PLUGIN], check=True)
    return library


def counted(plugin: Path, *words: str | Path, environment: dict[str, str] | None = None) -> int:
    """Return the instructions of an emulated program. words: the emulator's, then the program's."""
    file = plugin.with_suffix(".count")
    command = [COUNTING_EMULATOR, "-plugin", f"{plugin},out={file}", *words]
    answer = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert answer.returncode == 0, answer.stderr
    return int(file.read_text())


def board_python(folder: Path, suite: str, python: str) -> ForeignPython:
    """Install a board's wheelhouse into `folder` for the Python of a suite."""
    tree = foreign_python(suite) / "tree"
    house = wheelhouse(folder / "wheelhouse", architecture="aarch64", python=python)
    (wheels,) = house.glob("cp*/edge/aarch64")
    begin_s = time.monotonic()
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--quiet", "--no-index", "--no-deps"]
    command += ["--find-links", wheels, "--require-hashes"]
    command += ["--requirement", wheels / "packages.txt", "--requirement", wheels / "palpate.txt"]
    command += ["--target", folder / "packages", "--only-binary=:all:", "--python-version", python]
    command += ["--ignore-requires-python"]  # pip would compare with the Python that runs it
    for glibc in range(17, 37):
        command += ["--platform", f"manylinux_2_{glibc}_aarch64"]
    subprocess.run(command, check=True)
    print(f"wheels unpacked: {time.monotonic() - begin_s:.0f} s")
    return ForeignPython(tree, folder / "packages", python)
