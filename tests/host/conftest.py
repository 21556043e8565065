"""Helpers for the host's tests: the virtual bench and the hand of Table 4."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics


def _load_bench() -> ModuleType:
    name = "palpate_virtual_bench"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("virtual_bench.py"))
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


@pytest.fixture
def ahead_of_others() -> Iterator[None]:
    """Give the test, and what it starts, a processor before other tests where this user may do so.

    A drive switches off after 200 ms without RPDO 1, while three test processes and mypy share two cores.
    """
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    yield
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, before)


@pytest.fixture(scope="session")
def bench() -> ModuleType:
    """The module virtual_bench.py."""
    return _load_bench()


@pytest.fixture(scope="session")
def table_4(bench: ModuleType) -> tuple[HandConfig, HandKinematics]:
    """Configuration and hand of models/table4.toml."""
    result: tuple[HandConfig, HandKinematics] = bench.load_table_4()
    return result
