"""A hub in a process of its own, and ports on it."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import ModuleType

import can
import pytest
from hypothesis import HealthCheck, settings

from palpate_edge.bus import Bus, BusConfig, open_bus
from palpate_host.bus.client import HubBus

# No test depends on how busy the machine is.
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")

MAIN = "from palpate_host.bus.cli import bus; bus()"


class HubProcess:
    """`palpate-host bus hub` as a process."""

    def __init__(self, path: Path, *options: str) -> None:
        self.path = path
        self.process = subprocess.Popen(
            [sys.executable, "-c", MAIN, "hub", "--socket", str(path), *options],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stderr is not None
        self.first_line = self.process.stderr.readline()

    def stop(self) -> str:
        """SIGTERM; returns what it said at last."""
        self.process.terminate()
        return self._end()

    def kill(self) -> None:
        """SIGKILL: it cannot clean up."""
        self.process.kill()
        self._end()

    def _end(self) -> str:
        _, said = self.process.communicate(timeout=30)
        return said


@pytest.fixture
def start_hub(tmp_path: Path) -> Iterator[Callable[..., HubProcess]]:
    """Starts hubs on tmp_path/hub.sock; those still running are stopped at the end."""
    hubs: list[HubProcess] = []

    def start(*options: str) -> HubProcess:
        hubs.append(HubProcess(tmp_path / "hub.sock", *options))
        return hubs[-1]

    yield start
    for hub in hubs:
        if hub.process.poll() is None:
            hub.stop()


@pytest.fixture
def hub(start_hub: Callable[..., HubProcess]) -> HubProcess:
    """A hub at 1 Mbit/s with a transmit queue of 16 frames."""
    return start_hub("--txqueuelen", "16")


@pytest.fixture
def open_port(tmp_path: Path) -> Iterator[Callable[..., can.BusABC]]:
    """Opens python-can buses on tmp_path/hub.sock and shuts them down at the end."""
    with ExitStack() as ports:

        def open_one(name: str, **options: object) -> can.BusABC:
            port = can.Bus(interface="palpate", channel=str(tmp_path / "hub.sock"), name=name, **options)
            assert isinstance(port, HubBus)
            ports.callback(port.shutdown)
            return port

        yield open_one


@pytest.fixture
def open_edge(tmp_path: Path) -> Iterator[Callable[..., Bus]]:
    """The same through palpate_edge.bus."""
    config = BusConfig(interface="palpate", channel=str(tmp_path / "hub.sock"))
    with ExitStack() as buses:
        yield lambda name, accept_ids=None: buses.enter_context(open_bus(config, name, accept_ids))


@pytest.fixture(scope="session")
def foreign() -> ModuleType:
    """foreign.py: a slave and a master that are not ours."""
    name = "palpate_tests_bus_foreign"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name("foreign.py"))
        assert spec is not None and spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]
