"""Image of the test boards: bare Debian, built once and kept in .cache/deploy, and the wheelhouse; needs no
other library."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from kernel_guest.disks import PROJECT, digest, made

CACHE = PROJECT / ".cache" / "deploy"
RIG = Path(__file__).parent
ANSIBLE = PROJECT / "ansible"
TOOLS = PROJECT / ".venv-deploy" / "bin"


def missing(*tools: tuple[str, str]) -> str | None:
    """Return what is not installed and how to install it."""
    if os.geteuid() != 0:
        return "only root can make a board's namespaces and files: sudo make deploy-test"
    path = f"{os.environ.get('PATH', os.defpath)}:/usr/sbin:/sbin"
    for tool, package in (("mmdebstrap", "mmdebstrap"), ("ssh-keygen", "openssh-client"), *tools):
        if shutil.which(tool, path=path) is None:
            return f"{package} is missing: make system-deps"
    return None if ansible("ansible-playbook").exists() else "ansible is missing: make .venv-deploy/stamp"


def ansible(program: str) -> Path:
    """A program of ansible, from its own environment."""
    return TOOLS / program


SUITES = {"bookworm": "3.11", "trixie": "3.13"}
"""Debian's suites that a board may have, oldest first, each with its Python."""


def board_image(suite: str = "bookworm") -> Path:
    """The folder that build-board.sh fills."""
    own = sorted(path for path in (RIG / "board").rglob("*") if path.is_file())
    return _built(f"board-{suite}", RIG / "build-board.sh", *own, words=(suite,))


def foreign_python(suite: str = "bookworm") -> Path:
    """The folder that build-foreign.sh fills."""
    return _built(f"aarch64-{suite}", RIG / "build-foreign.sh", words=(suite,))


def _built(name: str, script: Path, *parts: Path, words: tuple[str, ...] = ()) -> Path:
    recipe = b"".join(path.read_bytes() for path in (script, *parts))
    target = CACHE / f"{name}-{digest(recipe)}"
    if not target.exists():
        with made(target) as folder:
            subprocess.run([script, folder, *words], check=True)
    return target


def wheelhouse(
    folder: Path,
    project: Path = PROJECT,
    architecture: str = "x86_64",
    parts: tuple[str, ...] = ("edge",),
    packages: Path | None = None,
    python: str = SUITES["bookworm"],
    key: Path | None = None,
) -> Path:
    """The wheelhouse of these sources, as `make wheelhouse` writes it; for a fingertip alone, unless told.

    python: the board's; packages: another wheelhouse's folder that the wheels of others are taken from; key:
    what signs it.
    """
    command = [sys.executable, project / "ansible/wheelhouse.py", folder, "--architecture", architecture]
    command += ["--python", python, *(["--key", key] if key else [])]
    offline = {"PIP_NO_INDEX": "1", "PIP_FIND_LINKS": str(packages)} if packages else {}
    words = [word for part in parts for word in ("--part", part)]
    subprocess.run([*command, *words], check=True, env={**os.environ, **offline})
    return folder


def changed_sources(folder: Path, file: str, old: str, new: str) -> Path:
    """A copy of the sources with one place changed: another release."""
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        folder.mkdir(exist_ok=True)
        shutil.copy(PROJECT / name, folder)
    for name in ("docs", "edge", "host", "requirements", "ansible", "systemd"):
        shutil.copytree(PROJECT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    text = (folder / file).read_text()
    assert old in text, f"{file} has no {old!r}"
    (folder / file).write_text(text.replace(old, new, 1))
    return folder


def changed_wheelhouse(folder: Path, wheels: Path, key: Path, file: str, old: str, new: str) -> Path:
    """A fingertip's wheelhouse of changed sources, with the packages and for the Python of `wheels`."""
    (packages,) = wheels.glob("cp*/edge/x86_64")
    (python,) = (python for python in SUITES.values() if f"/cp{python.replace('.', '')}/" in str(packages))
    sources = changed_sources(folder / "sources", file, old, new)
    return wheelhouse(folder / "wheelhouse", sources, packages=packages, python=python, key=key)


if __name__ == "__main__":
    for suite in sys.argv[1:] or SUITES:
        print(board_image(suite))
