"""Building CANopenNode's programs from a checkout, shown with one of two programs that print their names."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from kernel_guest.canopennode_build import CHECKOUT, MAKEFILES, SOURCES, build

pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="make is missing: make system-deps")

MAKEFILE = """
clean:
\trm -f {name}
{name}:
\tprintf '#!/bin/sh\\necho {name} $(GIT_VERSION)\\n' >$@; chmod +x $@
"""


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A checkout of CANopenDemo with other sources."""
    folder = tmp_path / "CANopenDemo"
    for name, place in MAKEFILES.items():
        (folder / place).mkdir(parents=True)
        (folder / place / "Makefile").write_text(MAKEFILE.format(name=name))
    (folder / SOURCES).parent.mkdir()
    (folder / SOURCES).touch()
    return folder


def files_of(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


def test_both_programs_are_built_and_the_checkout_stays_as_it_is(checkout, tmp_path):
    before = files_of(checkout)
    (tmp_path / "built").mkdir()
    programs = build(checkout, tmp_path / "built")
    assert programs.keys() == MAKEFILES.keys()
    for name, path in programs.items():
        assert (
            subprocess.run([path], capture_output=True, text=True, check=True).stdout == f"{name} checkout\n"
        )
    assert files_of(checkout) == before


def test_a_checkout_without_its_submodules_is_refused_with_the_command(checkout, tmp_path):
    (checkout / SOURCES).unlink()
    with pytest.raises(
        pytest.UsageError, match=rf"{CHECKOUT}: .* has no .*CANopen.c; git clone .* submodule"
    ):
        build(checkout, tmp_path)


def test_a_failed_build_is_reported_with_the_compilers_message(checkout, tmp_path):
    (checkout / "demo" / "Makefile").write_text("clean:\n\techo no such header >&2; false\n")
    with pytest.raises(pytest.UsageError, match=r"demoLinuxDevice cannot be built:\n[^$]*no such header"):
        build(checkout, tmp_path)
