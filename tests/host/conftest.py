"""Helpers for the host's tests: the virtual bench and the hand of Table 4."""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

from palpate_host.config.hand_config import HandConfig
from palpate_host.control.kinematics import HandKinematics
from palpate_host.service.real_time import request_fifo


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
def real_time() -> Iterator[None]:
    """The processes that the test starts are in the real-time class, where this one may: beside busy programs
    a local hub that waits for the processor stops the hand."""
    policy, parameters = os.sched_getscheduler(0), os.sched_getparam(0)
    request_fifo(10)
    yield
    os.sched_setscheduler(0, policy, parameters)


@pytest.fixture(scope="session")
def bench() -> ModuleType:
    """The module virtual_bench.py."""
    return _load_bench()


@pytest.fixture(scope="session")
def table_4(bench: ModuleType) -> tuple[HandConfig, HandKinematics]:
    """Configuration and hand of models/table4.toml."""
    result: tuple[HandConfig, HandKinematics] = bench.load_table_4()
    return result
