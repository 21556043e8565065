"""The wheelhouse of the boards' own processor, run by an emulator: it imports, a frame gives its contact.

What runs is Debian's Python for aarch64 and the wheels that a board installs; times do not apply to boards.
"""

from __future__ import annotations

import csv
import shutil
import struct
import subprocess
import sys

import pytest
from bench.instructions import HELD_AARCH64, measure, table

from deploy_rig.foreign_python import COUNTING_EMULATOR, EMULATOR, board_python, counted, instruction_plugin
from deploy_rig.image import missing

pytestmark = pytest.mark.deploy_foreign

MODULES = ("can", "canopen", "click", "cv2", "msgspec", "numpy", "onnxruntime", "smbus2")
SEEN = f"""
import platform, palpate_edge.daemon.daemon
import {", ".join(MODULES)}
print(platform.machine(), *{MODULES})
"""


@pytest.fixture(scope="module")
def aarch64(suite, python, tmp_path_factory):
    """The Python of a board with its wheels."""
    if (reason := missing((EMULATOR, "qemu-user-static"))) is not None:
        pytest.skip(reason)
    return board_python(tmp_path_factory.mktemp("aarch64"), suite, python)


def test_every_wheel_imports(aarch64):
    assert aarch64.run("-c", SEEN).split() == ["aarch64", *MODULES]


def test_a_frame_gives_its_contact(aarch64, drawn_dataset, tmp_path):
    """With the correction model, by the program that a board runs, as on this computer."""
    frames, calibration = tmp_path / "frames", tmp_path / "drawn.cal"
    frames.mkdir()
    shutil.copy(drawn_dataset / "frames/003.png", frames)
    here = [sys.executable, "-m", "palpate_edge.cli.main"]
    subprocess.run([*here, "calibrate", drawn_dataset, "-o", calibration], check=True)
    words = ["estimate", str(frames), "--calibration", str(calibration), "--method", "corrected", "--csv"]
    subprocess.run([*here, *words, tmp_path / "here.csv"], check=True)
    aarch64.run("-m", "palpate_edge.cli.main", *words, str(tmp_path / "there.csv"))
    (there,), (here,) = (
        list(csv.DictReader((tmp_path / name).read_text().splitlines())) for name in ("there.csv", "here.csv")
    )
    numbers = [key for key, value in here.items() if key.endswith(("_mm", "_N")) and value]
    assert len(numbers) >= 6
    print(", ".join(f"{key} {there[key]} ({here[key]} here)" for key in numbers))
    for key in numbers:
        assert float(there[key]) == pytest.approx(float(here[key]), abs=2e-3), key


@pytest.fixture
def counting():
    """Skip without an emulator that loads plug-ins, or a compiler."""
    if (reason := missing((COUNTING_EMULATOR, "qemu-user"), ("cc", "gcc"))) is not None:
        pytest.skip(reason)


LOOPS = 60_000
LOOP = (
    0xD2800000 | LOOPS << 5,  # mov x0, LOOPS
    0xF1000400,  # subs x0, x0, 1
    0x54FFFFE1,  # b.ne to the line before
    0xD2800BA8,  # mov x8, 93 (exit)
    0xD4000001,  # svc 0
)


@pytest.mark.usefixtures("counting")
def test_the_instructions_of_a_loop_are_counted(tmp_path):
    """A program of five instructions, without libraries."""
    base, text = 0x400000, struct.pack("<5I", *LOOP)
    elf = struct.pack(
        "<16sHHIQQQIHHHHHH", b"\x7fELF\2\1\1", 2, 183, 1, base + 120, 64, 0, 0, 64, 56, 1, 0, 0, 0
    )
    segment = struct.pack("<IIQQQQQQ", 1, 5, 0, base, base, 120 + len(text), 120 + len(text), 0x10000)
    program = tmp_path / "loop"
    program.write_bytes(elf + segment + text)
    program.chmod(0o755)
    assert counted(instruction_plugin(tmp_path), program) == 1 + 2 * LOOPS + 2


@pytest.mark.usefixtures("counting")
def test_the_daemon_keeps_its_budget(aarch64, suite):
    """With a board's Python and wheels; the counts of Debian 12 are held."""
    rows = measure(aarch64.counter, HELD_AARCH64)
    print(table(rows, f"aarch64, {suite}"))
    if suite == "bookworm":
        assert not [row for row in rows if row.count > 1.1 * row.held]
