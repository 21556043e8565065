"""Modules that are loaded before a test runs in the virtual machine, whose processor has no AVX."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

PROGRAM = """
import sys
import pytest
pytest.main(["--collect-only", "-q", "-p", "no:cacheprovider", *sys.argv[1:]])
print("mujoco" in sys.modules)
"""


def test_no_mujoco_is_loaded_before_the_tests_of_the_virtual_machine_begin() -> None:
    """MuJoCo's library ends the process on a processor without AVX."""
    names, _ = collected("-m", "vm", str(Path(__file__).parent))
    files = sorted({name.split("::")[0] for name in names if "::" in name})
    assert "tests/kernel/test_v4l2_camera.py" in files
    again, mujoco_is_loaded = collected(*files)
    assert len(again) > len(files)
    assert mujoco_is_loaded == "False"


def collected(*arguments: str) -> tuple[list[str], str]:
    """The lines that pytest printed of the tests it would run, and whether MuJoCo was loaded."""
    command = [sys.executable, "-c", PROGRAM, *arguments]
    lines = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    return lines[:-1], lines[-1]
