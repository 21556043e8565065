"""What every command of the host begins with, in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

THREADS = """
import click
from palpate_host.cli.main import run_cli

@click.command()
def command():
    import os
    import numpy
    click.echo(len(os.listdir("/proc/self/task")))

run_cli(command)
"""


def _run(program: str, threads: dict[str, str]) -> str:
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, env=environment | threads, capture_output=True, text=True, check=True)
    return ended.stdout.strip()


def test_matrices_are_multiplied_in_one_thread_but_where_the_environment_says_else() -> None:
    assert _run(THREADS, {}) == "1"
    assert _run(THREADS, {"OPENBLAS_NUM_THREADS": "2"}) == str(min(2, len(os.sched_getaffinity(0))))


def test_a_command_loads_no_numpy_before_its_own_code_does() -> None:
    assert _run("import sys, palpate_host.cli.main; print('numpy' in sys.modules)", {}) == "False"
