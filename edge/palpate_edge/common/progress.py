"""A progress bar for commands that take longer than a breath."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, redirect_stdout
from pathlib import Path

import click

from palpate_edge.common.atomic_write import STANDARD_OUTPUT


@contextmanager
def notes_beside(output: Path | None) -> Iterator[None]:
    """Print the block's notes to standard error when `output`, the command's file, is standard output."""
    with redirect_stdout(sys.stderr) if output == STANDARD_OUTPUT else nullcontext():
        yield


@contextmanager
def progress_bar(label: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr that learns its length with the first step; silent when not a terminal."""
    with click.progressbar(length=1, label=label, file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:

        def progress(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        yield progress
