"""Test of what pytest loads before a test runs in the virtual machine, whose processor has no AVX."""

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


def test_no_mujoco_is_loaded_before_the_tests_of_the_kernels_begin() -> None:
    """MuJoCo's library ends the process on a processor without AVX."""
    files = map(str, sorted(Path(__file__).parent.glob("test_*.py")))
    collected = subprocess.run(
        [sys.executable, "-c", PROGRAM, *files], capture_output=True, text=True, check=True
    )
    assert "test_canfd.py::" in collected.stdout
    assert collected.stdout.splitlines()[-1] == "False"
