"""Header, client's constants and docs page are what registers.toml and the build say."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[2]


def test_generated_files_are_up_to_date() -> None:
    script = PROJECT / "firmware" / "illumination" / "generate.py"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_size_and_stack_are_within_their_budgets_and_told(build: Path) -> None:
    text = (build / "budget.txt").read_text()
    flash, ram, stack = map(int, re.findall(r"(\d+)(?: of|\))", text))
    assert (flash <= 8192, ram <= 1024, 0 < stack < ram) == (True, True, True)
    version = subprocess.run(["avr-gcc", "-dumpversion"], capture_output=True, text=True, check=True)
    if not version.stdout.startswith("5.4."):
        pytest.skip("docs/illumination.md tells the sizes of avr-gcc 5.4")
    page = " ".join((PROJECT / "docs" / "illumination.md").read_text().split())
    assert f"{flash} of 32768 bytes, RAM {ram} of 2048 bytes, of which the deepest stack {stack} " in page
