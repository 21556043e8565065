"""The first contact of docs/building.md: its commands, their run in a folder, the contacts on the screen."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "building.md"
OUTER_RADIUS_MM = 30.0
CONTACT = re.compile(
    r"contact x (-?[\d.]+) mm, Value of contact y (-?[\d.]+) mm, Value of contact z (-?[\d.]+) mm"
)
END = "trap 'kill $(jobs -p); wait' EXIT"  # what the page's reader does with the commands in the background


def commands() -> list[str]:
    """Return the page's lines, each a command of palpate."""
    page = PAGE.read_text().split("## First contact")[1]
    lines = page.split("```sh\n")[1].split("```")[0].splitlines()
    assert all(line.startswith(("palpate-edge ", "palpate-host ")) for line in lines)
    return lines


def walk(folder: Path, programs: Path, *, limit_s: float) -> str:
    """Run the page's commands in a folder as they are written; return what is on the screen.

    programs: the folder of palpate-edge and palpate-host. The hub's socket is beside `folder`.
    """
    environment = {
        **os.environ,
        "PATH": f"{programs}:{os.environ['PATH']}",
        "XDG_RUNTIME_DIR": str(folder.parent),
        "PALPATE_HUB": str(folder.parent / "hub.sock"),
    }
    done = subprocess.run(
        ["timeout", f"{limit_s:g}", "bash", "-e", "-c", "\n".join([END, *commands()])],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


def contacts(screen: str) -> list[tuple[float, float, float]]:
    """Return the x, y, z, mm, of each TPDO 1 on the screen; (0, 0, 0) without contact."""
    return [(float(x), float(y), float(z)) for x, y, z in CONTACT.findall(screen)]
