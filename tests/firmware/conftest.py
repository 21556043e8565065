"""The firmware built once, as the chip's binary and as a library of its logic for this machine."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from firmware_rig.need import need, need_simulator

if TYPE_CHECKING:
    from firmware_rig.simulated_controller import SimulatedController

PROJECT = Path(__file__).resolve().parents[2]
SOURCES = Path(os.environ.get("PALPATE_FIRMWARE", PROJECT / "firmware" / "illumination"))  # set by mutate.py


@pytest.fixture(scope="session")
def build(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of illumination.elf, built as a user does."""
    need("avr-gcc", "gcc-avr, avr-libc")
    folder = tmp_path_factory.mktemp("firmware")
    subprocess.run(["make", "-C", SOURCES, f"BUILD={folder}"], check=True, capture_output=True, text=True)
    return folder


@pytest.fixture(scope="session")
def logic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """core.c as a shared library with every warning and the sanitizer of undefined behaviour."""
    need("cc", "gcc")
    library = tmp_path_factory.mktemp("logic") / "core.so"
    command = ["cc", "-std=gnu11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    sanitize = ["-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]
    subprocess.run([*command, *sanitize, "-o", library, SOURCES / "core.c"], check=True)
    return library


@pytest.fixture
def controller(build: Path) -> Iterator[SimulatedController]:
    """The real binary, 20 ms after power-on."""
    need_simulator()
    from firmware_rig.simulated_controller import SimulatedController

    simulated = SimulatedController(build / "illumination.elf")
    simulated.run_ms(20)
    yield simulated
