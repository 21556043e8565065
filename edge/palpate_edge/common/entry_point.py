"""Entry point of both command lines: errors become one line and an exit status."""

from __future__ import annotations

import logging
import os
import sys
from typing import NoReturn

import click

from palpate_edge.common.errors import (
    DISK_ERRORS,
    MissingExtraError,
    PalpateError,
    missing_library,
    reason_of,
)
from palpate_edge.common.logs import with_priority, write_tracebacks_with_priority


def run_cli(command: click.Command) -> None:
    """Run a command line; PalpateError becomes ``error: ...`` and the class's exit status.

    A missing library of an extra becomes one line with the command that installs it. A full, read-only or
    failing disk, standard output included, becomes one line as well, with status 1. Any other exception is a
    fault of the program: its traceback is written, in the journal as critical.

    Matrices are multiplied in one thread, here where numpy is not loaded yet, and in every process that the
    command starts: sums then do not depend on the number of cores, and these matrices are too small to gain.
    ``OPENBLAS_NUM_THREADS`` in the environment takes precedence.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    write_tracebacks_with_priority()
    try:
        command.main(standalone_mode=True)
    except PalpateError as error:
        _exit_with(str(error), error.exit_status)
    except ModuleNotFoundError as error:
        library = missing_library(error)
        if library is None:
            raise
        missing = MissingExtraError("this command", library)
        _exit_with(str(missing), missing.exit_status)
    except OSError as error:
        if error.errno not in DISK_ERRORS:
            raise
        _exit_with(
            f"{error.filename or 'output'} cannot be written: {reason_of(error)}; "
            "free some space or give another path",
            1,
        )


def _exit_with(message: str, status: int) -> NoReturn:
    click.echo(with_priority(f"error: {message}", logging.ERROR, sys.stderr), err=True)
    try:
        sys.stdout.flush()
    except OSError:  # the interpreter would try again at its end, and complain
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    sys.exit(status)
