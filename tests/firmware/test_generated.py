"""Header, client's constants and docs page are what registers.toml says."""

import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]


def test_generated_files_are_up_to_date() -> None:
    script = PROJECT / "firmware" / "illumination" / "generate.py"
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")
