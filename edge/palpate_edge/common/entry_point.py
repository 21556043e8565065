"""How every command of ours is run."""

from __future__ import annotations

import logging
import os
import sys

import click

from palpate_edge.common.errors import PalpateError
from palpate_edge.common.logs import with_priority


def run_cli(command: click.Command) -> None:
    """Run a command line; PalpateError becomes ``error: ...`` and the class's exit status.

    Matrices are multiplied in one thread, here where numpy is not loaded yet, and in every process that the
    command starts: sums then do not depend on how many cores there are, and ours are too small to gain.
    ``OPENBLAS_NUM_THREADS`` in the environment goes ahead of that.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        command.main(standalone_mode=True)
    except PalpateError as error:
        click.echo(with_priority(f"error: {error}", logging.ERROR, sys.stderr), err=True)
        sys.exit(error.exit_status)
