"""Tests whose tool is not installed skip and name it."""

from __future__ import annotations

import shutil

import pytest


def need(program: str, package: str) -> None:
    if shutil.which(program) is None:
        pytest.skip(f"{program} is missing: make system-deps installs it ({package})")
