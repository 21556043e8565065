"""Build CANopenNode's programs from a checkout of CANopenDemo, which PALPATE_CANOPENNODE names.

The checkout has the submodule CANopenLinux, and CANopenNode inside it. It is copied, so it stays as it is.
The build runs outside of the guests, at the first test that is marked ``canopennode``.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

CHECKOUT = "PALPATE_CANOPENNODE"
VARIABLES = {"canopend": "PALPATE_CANOPEND", "demoLinuxDevice": "PALPATE_CANOPEN_DEMO"}
"""Environment variable with the path of each program; it precedes the checkout."""

MAKEFILES = {"canopend": Path("CANopenLinux"), "demoLinuxDevice": Path("demo")}
SOURCES = Path("CANopenLinux", "CANopenNode", "CANopen.c")  # of the innermost submodule
CLONE = (
    "git clone https://github.com/CANopenNode/CANopenDemo; "
    "git -C CANopenDemo submodule update --init --recursive CANopenLinux"
)


def build(checkout: Path, folder: Path) -> dict[str, Path]:
    """Copy the checkout into `folder` and return the path of each program.

    Raises pytest.UsageError when the checkout is incomplete or a program cannot be built.
    """
    if not (checkout / SOURCES).is_file():
        raise pytest.UsageError(f"{CHECKOUT}: {checkout} has no {SOURCES}; {CLONE}")
    copy = folder / "checkout"
    shutil.copytree(checkout, copy, ignore=shutil.ignore_patterns(".git"))
    programs = {}
    for name, place in MAKEFILES.items():
        # Both Makefiles compile the same sources with other options, so each begins with `clean`.
        command = ["make", "-C", str(copy / place), "GIT_VERSION=checkout", "clean", name]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            raise pytest.UsageError(f"{CHECKOUT}: make is missing: make system-deps") from None
        if done.returncode:
            raise pytest.UsageError(f"{CHECKOUT}: {name} cannot be built:\n{done.stderr}")
        programs[name] = shutil.move(copy / place / name, folder / name)
    return programs


class BuildOnDemand:
    """A pytest plugin that builds the programs when a test of the session needs them."""

    def __init__(self, checkout: Path) -> None:
        self._checkout = checkout
        self._folder = tempfile.TemporaryDirectory(prefix="palpate-canopennode-")

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        is_needed = any(item.get_closest_marker("canopennode") for item in session.items)
        if is_needed and not session.config.option.collectonly:
            for name, path in build(self._checkout, Path(self._folder.name)).items():
                os.environ.setdefault(VARIABLES[name], str(path))

    def pytest_unconfigure(self) -> None:
        self._folder.cleanup()


def pytest_configure(config: pytest.Config) -> None:
    # Inside a guest the variable is not set: the programs' paths are passed there.
    if checkout := os.environ.get(CHECKOUT):
        config.pluginmanager.register(BuildOnDemand(Path(checkout)))
