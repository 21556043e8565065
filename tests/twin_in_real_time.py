"""The processes of the demo in real time, with an object that a host grasps."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate_host.common.mode import Mode
from palpate_host.operator.client import NoHostError, OperatorClient
from palpate_host.operator.protocol import Status
from palpate_twin.demo.orchestrator import commands
from palpate_twin.demo.processes import Children
from palpate_twin.demo.programme import TURNS_DEG
from palpate_twin.demo.run_folder import RunFolder, bind_calibrations, make_run_folder

PATIENCE_S = 600.0


@contextmanager
def twin_in_real_time(path: Path, *host_options: str) -> Iterator[RunFolder]:
    """Run the demo's processes in a folder; no programme turns the object and nothing pushes it.

    A simulated finger has no friction that would hold it: in READY, without torque, it falls on the object.
    """
    folder = make_run_folder(path, None, 1_000_000)
    text = folder.hand_toml.read_text()
    first_turn = f"rpy_deg = {list(TURNS_DEG[0])}"
    assert first_turn in text
    text, _, _ = text.partition("[[twin.disturbances]]")
    folder.hand_toml.write_text(text.replace(first_turn, "rpy_deg = [0.0, 0.0, 0.0]"))
    prepare, hub, plant, *tips, host = commands(folder, folder.hand(), None)
    with Children(folder.path) as children:
        for command in (prepare, hub, plant, *tips):
            child = children.start(command.name, command.program, command.arguments)
            if command is prepare:
                wait_for(lambda child=child: child.process.poll() is not None, "the sensors")
                children.stop(command.name)
                bind_calibrations(folder)
            if command is hub:
                wait_for(folder.hub_socket.exists, "the hub")
            if command is plant:
                rings = [folder.ring(finger.name) for finger in folder.hand().fingers]
                wait_for(lambda rings=rings: all(map(Path.exists, rings)), "the cameras")
        options = ("--config", folder.hand_toml, "--socket", folder.control_socket, *host_options)
        children.start(host.name, host.program, ("run", *map(str, options)))
        yield folder
        for command in (host, plant, *tips, hub):
            children.stop(command.name)


def mode(control_socket: Path) -> Mode:
    try:
        with OperatorClient(control_socket) as client:
            status = client.ask(Status())
    except NoHostError:
        return Mode.UNKNOWN
    return Mode.UNKNOWN if status is None else status.mode


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not come"
        time.sleep(0.05)
