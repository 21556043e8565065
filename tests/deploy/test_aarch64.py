"""The wheelhouse of the boards' own processor, run by an emulator: it imports, a frame gives its contact.

What runs is Debian's Python for aarch64 and the wheels that a board installs; times do not apply to boards.
"""

from __future__ import annotations

import csv
import shutil
import subprocess
import sys
import time

import pytest

from deploy_rig.image import foreign_python, missing, wheelhouse

pytestmark = pytest.mark.deploy_foreign

EMULATOR = "qemu-aarch64-static"
MODULES = ("can", "canopen", "click", "cv2", "msgspec", "numpy", "onnxruntime", "smbus2")
SEEN = f"""
import platform, palpate_edge.daemon.daemon
import {", ".join(MODULES)}
print(platform.machine(), *{MODULES})
"""


@pytest.fixture(scope="module")
def board_python(suite, python, tmp_path_factory):
    """Runs palpate's Python as a board of aarch64 would."""
    if (reason := missing((EMULATOR, "qemu-user-static"))) is not None:
        pytest.skip(reason)
    tree = foreign_python(suite) / "tree"
    folder = tmp_path_factory.mktemp("aarch64")
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

    def run(*words):
        environment = ("-E", f"PYTHONPATH={folder / 'packages'}", "-E", "PYTHONDONTWRITEBYTECODE=1")
        program = (EMULATOR, "-cpu", "cortex-a53", "-L", tree, *environment, tree / f"usr/bin/python{python}")
        begin_s = time.monotonic()
        answer = subprocess.run([*program, *words], capture_output=True, text=True, check=False)
        assert answer.returncode == 0, answer.stderr
        print(f"{words[1][:30].strip()}: {time.monotonic() - begin_s:.1f} s under emulation")
        return answer.stdout

    return run


def test_every_wheel_imports(board_python):
    assert board_python("-c", SEEN).split() == ["aarch64", *MODULES]


def test_a_frame_gives_its_contact(board_python, drawn_dataset, tmp_path):
    """With the correction model, by the program that a board runs, as on this computer."""
    frames, calibration = tmp_path / "frames", tmp_path / "drawn.cal"
    frames.mkdir()
    shutil.copy(drawn_dataset / "frames/003.png", frames)
    here = [sys.executable, "-m", "palpate_edge.cli.main"]
    subprocess.run([*here, "calibrate", drawn_dataset, "-o", calibration], check=True)
    words = ["estimate", str(frames), "--calibration", str(calibration), "--method", "corrected", "--csv"]
    subprocess.run([*here, *words, tmp_path / "here.csv"], check=True)
    board_python("-m", "palpate_edge.cli.main", *words, str(tmp_path / "there.csv"))
    (there,), (here,) = (
        list(csv.DictReader((tmp_path / name).read_text().splitlines())) for name in ("there.csv", "here.csv")
    )
    numbers = [key for key, value in here.items() if key.endswith(("_mm", "_N")) and value]
    assert len(numbers) >= 6
    print(", ".join(f"{key} {there[key]} ({here[key]} here)" for key in numbers))
    for key in numbers:
        assert float(there[key]) == pytest.approx(float(here[key]), abs=2e-3), key
