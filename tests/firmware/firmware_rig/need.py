"""Tests whose tool is not installed skip and name it."""

from __future__ import annotations

import importlib.util
import shutil

import pytest


def need(program: str, package: str) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is missing: make system-deps installs it ({package})")


def need_simulator() -> None:
    if importlib.util.find_spec("yasimavr") is None:
        pytest.skip("yasimavr is missing: run make system-deps, then make test, which installs it")
