"""A served control socket, and the programs of LeRobot's own environment."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from tests.twin_in_real_time import PATIENCE_S, mode, twin_in_real_time, wait_for

from palpate_host.common.command import Command, CommandError
from palpate_host.common.mode import Mode
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.statuses import read_statuses
from palpate_host.service.host import load_hand
from palpate_twin.demo.run_folder import RunFolder

PROJECT = Path(__file__).resolve().parents[2]
HAND = PROJECT / "host/palpate_host/models/table4.toml"
PLUGIN = PROJECT / "integrations/lerobot_robot_palpate/lerobot_robot_palpate"
LEROBOT = PROJECT / ".venv-lerobot" / "bin"
DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")


@pytest.fixture(scope="session")
def status() -> HostStatus:
    """Return a tick in which every finger touches and the object turns."""
    statuses = read_statuses(PROJECT / "tests/replay/virtual.log.gz", *load_hand(HAND))
    return next(
        s
        for s in statuses
        if s.mode is Mode.MANIPULATE and s.R_d and all(finger.in_contact for finger in s.fingers)
    )


@pytest.fixture(scope="session")
def twin(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunFolder]:
    """The processes of the demo in real time; the host grasps the object and turns it nowhere."""
    with twin_in_real_time(tmp_path_factory.mktemp("twin") / "run") as folder:
        wait_for(lambda: mode(folder.control_socket) is Mode.MANIPULATE, "the grasp")
        yield folder


class Serving:
    """A control socket that a thread serves; `commands` are the accepted ones."""

    def __init__(self, path: Path, status: HostStatus, refusal: str = "") -> None:
        self.path, self.commands = path, list[Command]()
        self._refusal, self._ended = refusal, threading.Event()
        self._socket = OperatorSocket(path)
        self._thread = threading.Thread(target=self._run, args=(status,))
        self._thread.start()

    def _run(self, status: HostStatus) -> None:
        while not self._ended.wait(0.002):
            self._socket.serve(self._execute, status)

    def _execute(self, command: Command) -> None:
        if self._refusal:
            raise CommandError(self._refusal)
        self.commands.append(command)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], ModuleType]]:
    """``plugin(name)``: a module of the plug-in, without its package's own imports of LeRobot."""
    package = ModuleType("lerobot_robot_palpate")
    package.__path__ = [str(PLUGIN)]
    monkeypatch.setitem(sys.modules, package.__name__, package)
    yield lambda name: importlib.import_module(f"{package.__name__}.{name}")
    for name in [name for name in sys.modules if name.startswith(f"{package.__name__}.")]:
        del sys.modules[name]


@pytest.fixture(scope="session")
def lerobot(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """``lerobot(program, *arguments)``: run a program of LeRobot's environment and return its output."""
    if not (LEROBOT / "lerobot-record").exists():
        pytest.skip("LeRobot is not installed: make lerobot-test")
    home = tmp_path_factory.mktemp("home")
    environment = {
        **{name: value for name, value in os.environ.items() if name not in DISPLAYS},
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(home),
        "HF_LEROBOT_HOME": str(home / "lerobot"),
        "OMP_NUM_THREADS": "1",
    }

    def run(program: str, *arguments: object) -> str:
        done = subprocess.run(
            [LEROBOT / program, *map(str, arguments)],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout[-4000:]
        return done.stdout

    return run
