"""A served control socket, and the programs of LeRobot's own environment."""

from __future__ import annotations

import os
import subprocess
import threading
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest
from tests.lerobot_plugin import plugin_modules
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
    """A control socket that a thread serves; `commands` are the accepted ones.

    tick: calculates a tick's status from the last one and the number of commands; by default they are equal.
    """

    def __init__(
        self,
        path: Path,
        status: HostStatus,
        refusal: str = "",
        tick: Callable[[HostStatus, int], HostStatus] = lambda status, _: status,
    ) -> None:
        self.path, self.commands = path, list[Command]()
        self._tick = tick
        self._refusal, self._ended = refusal, threading.Event()
        self._socket = OperatorSocket(path)
        self._thread = threading.Thread(target=self._run, args=(status,))
        self._thread.start()

    def _run(self, status: HostStatus) -> None:
        while not self._ended.wait(0.002):
            self._socket.serve(self._execute, status)
            status = self._tick(status, len(self.commands))

    def _execute(self, command: Command) -> None:
        if self._refusal:
            raise CommandError(self._refusal)
        self.commands.append(command)

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()


@pytest.fixture
def plugin() -> Iterator[Callable[[str], ModuleType]]:
    """``plugin(name)``: a module of the plug-in, without its package's own imports of LeRobot."""
    with plugin_modules() as module:
        yield module


@cache
def real_time() -> tuple[str, ...]:
    """Return what starts a program in the real-time class; empty where this process may not."""
    words = ("chrt", "--fifo", "10")
    try:
        is_allowed = subprocess.run([*words, "true"], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return ()
    return words if is_allowed else ()


@pytest.fixture(scope="session")
def lerobot(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """``lerobot(program, *arguments, **environment)``: run a program of LeRobot and return its output.

    It runs in the real-time class where that is allowed, as docs/integrations.md recommends.
    """
    if not (LEROBOT / "lerobot-record").exists():
        pytest.skip("LeRobot is not installed: make lerobot-test")
    home = tmp_path_factory.mktemp("home")
    common = {
        **{name: value for name, value in os.environ.items() if name not in DISPLAYS},
        "HF_HUB_OFFLINE": "1",
        "HF_HOME": str(home),
        "HF_LEROBOT_HOME": str(home / "lerobot"),
        "OMP_NUM_THREADS": "1",
    }

    def run(program: str, *arguments: object, **environment: str) -> str:
        done = subprocess.run(
            [*real_time(), LEROBOT / program, *map(str, arguments)],
            env=common | environment,
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
