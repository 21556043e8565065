"""A hub in a process of its own, real SocketCAN beside it, and ports on them."""

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

from kernel_guest.kernels import IN_A_KERNEL
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus

# No test depends on how busy the machine is.
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")

MAIN = "from palpate_bus.cli.main import bus; bus()"


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


@pytest.fixture(params=["hub", *IN_A_KERNEL])
def any_bus(request: pytest.FixtureRequest) -> BusConfig:
    """A bus that is there: the hub's, or vcan0 in a kernel that has SocketCAN."""
    if request.param == "hub":
        return BusConfig(interface="palpate", channel=str(request.getfixturevalue("hub").path))
    return BusConfig(interface="socketcan", channel=request.getfixturevalue("vcan").name)


@pytest.fixture
def bus_config(request: pytest.FixtureRequest, tmp_path: Path) -> BusConfig:
    """The bus of `any_bus` in a test that uses it, else the hub on tmp_path/hub.sock, running or not."""
    if "any_bus" in request.fixturenames:
        return request.getfixturevalue("any_bus")
    return BusConfig(interface="palpate", channel=str(tmp_path / "hub.sock"))


@pytest.fixture
def open_port(bus_config: BusConfig) -> Iterator[Callable[..., can.BusABC]]:
    """Opens python-can buses on `bus_config` and shuts them down at the end."""
    with ExitStack() as ports:

        def open_one(name: str, **options: object) -> can.BusABC:
            if bus_config.interface == "palpate":
                options["name"] = name
            port = can.Bus(interface=bus_config.interface, channel=bus_config.channel, **options)
            ports.callback(port.shutdown)
            return port

        yield open_one


@pytest.fixture
def open_edge(bus_config: BusConfig) -> Iterator[Callable[..., Bus]]:
    """The same through palpate_edge.can_bus.bus."""
    with ExitStack() as buses:
        yield lambda name, accept_ids=None: buses.enter_context(open_bus(bus_config, name, accept_ids))


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
