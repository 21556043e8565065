"""The commands of docs/integrations.md, as a user of each system types them, and a shell that runs them."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "integrations.md"
FENCE = re.compile(r"^```(?:sh)?\n(.*?)^```", re.MULTILINE | re.DOTALL)
PROGRAM = f'palpate-host() {{ {sys.executable} -W ignore -m palpate_host.cli.main "$@"; }}'
"""palpate-host of this environment, which may have no script of that name."""
PATIENCE_S = 60.0


def commands(heading: str) -> list[str]:
    """Return the commands of the first block of code below a heading; `\\` at a line's end joins lines."""
    below = re.split(rf"^#+ {re.escape(heading)}$", PAGE.read_text(), flags=re.MULTILINE)[1]
    block = FENCE.search(below)
    assert block is not None, f"{PAGE.name}: no commands below {heading}"
    return joined(block[1])


def all_commands() -> list[str]:
    """Return the commands of every block of code of the page."""
    return [line for block in FENCE.findall(PAGE.read_text()) for line in joined(block)]


def joined(block: str) -> list[str]:
    return re.sub(r"\\\n\s*", "", block).splitlines()


@contextmanager
def shell(lines: list[str], folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run commands in a folder until the end of the block; the hand's control socket is in the folder too."""
    process = subprocess.Popen(
        ["bash", "-e", "-c", "\n".join([PROGRAM, *lines, "wait"])],
        cwd=folder,
        env=os.environ | {"PALPATE_CONTROL": str(folder / "host.sock")},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate(timeout=PATIENCE_S)
