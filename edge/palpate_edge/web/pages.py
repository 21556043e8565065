"""The files of a page and its addresses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

SHARED = Path(__file__).parent / "page"
CONSOLE_END = "Ctrl-C ends the console"


def page_files(folder: Path, name: str) -> Mapping[str, Path]:
    """Return path of the URL -> file: `name`.html of `folder` at /, its scripts, and the shared files."""
    files = {f"/{file.name}": file for file in (*sorted(SHARED.iterdir()), *sorted(folder.glob("*.js")))}
    return {**files, "/": folder / f"{name}.html"}


def addresses(port: int, token: str, end: str = CONSOLE_END) -> list[str]:
    """Return the lines for the person who started a console: its addresses, the way over ssh, and how it
    ends."""
    address = f"http://127.0.0.1:{port}/"
    return [
        f"to command:   {address}#token={token}",
        f"to watch:     {address}",
        f"from another machine: ssh -L {port}:127.0.0.1:{port} USER@THIS-MACHINE, then open it there",
        end,
    ]
