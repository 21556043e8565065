"""Serve a page while a block runs, and name its addresses to the person who started it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import CONSOLE_END, addresses
from palpate_edge.web.server import ConsoleServer, RunCommand


@contextmanager
def serve_page(
    files: Mapping[str, Path],
    port: int,
    token: str,
    broadcast: Broadcast,
    run_command: RunCommand,
    report: Callable[[str], None],
    end: str = CONSOLE_END,
) -> Iterator[None]:
    """Serve `files` on 127.0.0.1 during the block; `report` takes the lines of `addresses`.

    Raises ConfigError when the port cannot be used.
    """
    server = ConsoleServer(port, token, files, broadcast, run_command)
    with server.serving():
        for line in addresses(server.port, token, end):
            report(line)
        yield
