"""A fingertip's board in namespaces, the hub that stands for its bus, a master on it, and its playbooks."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from deploy_rig.master import Master, master_on
from deploy_rig.namespace_board import NamespaceBoard, namespace_board
from deploy_rig.playbooks import Playbooks, Played
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.datasets.press_dataset import read_dataset

SERVICE = "palpate-fingertip.service"
HUB = "from palpate_bus.cli.main import bus; bus()"


@dataclass(frozen=True)
class SlowCamera:
    """Presses at 10 frames a second, which no busy machine drops, and their calibration."""

    presses: Path
    calibration: Path


def slow_camera(dataset: Path, folder: Path) -> SlowCamera:
    """Slow a drawn dataset down."""
    presses = shutil.copytree(dataset, folder / "presses")
    sensor = presses / "sensor.toml"
    sensor.write_text(sensor.read_text().replace("fps = 30", "fps = 10"))
    save_calibration(calibrate(read_dataset(presses)), folder / "slow.cal")
    return SlowCamera(presses, folder / "slow.cal")


@dataclass(frozen=True)
class FingertipBoard:
    """A booted board."""

    machine: NamespaceBoard
    master: Master
    playbooks: Playbooks
    folder: Path

    def play(self, book: str, *words: str, **variables: Any) -> Played:
        """Run a playbook on the board and print its time, and the processor time that it took."""
        begin_s, before = time.monotonic(), (_children_s(), self.machine.processor_s())
        played = self.playbooks.play(book, *words, **variables)
        taken_s = time.monotonic() - begin_s
        ansible_s, board_s = _children_s() - before[0], self.machine.processor_s() - before[1]
        processor = f"processor: ansible {ansible_s:.0f} s, board {board_s:.0f} s"
        print(f"{book} {' '.join(words)}: {played.changed} changed, {taken_s:.0f} s ({processor})")
        return played

    def shown(self, name: str, unit: str = SERVICE) -> str:
        """Return a property of a unit."""
        return self.machine.run("systemctl", "show", "--value", f"--property={name}", unit)

    def serving(self) -> str:
        """Return the active release."""
        return self.machine.run("readlink", "/opt/palpate/current", check=False).removeprefix("releases/")


def _children_s() -> float:
    """Return the processor time of the programs that this process has waited for."""
    used = os.times()
    return used.children_user + used.children_system


@contextmanager
def fingertip_board(
    folder: Path, key: Path, wheels: Path, camera: SlowCamera, *layers: Path
) -> Iterator[FingertipBoard]:
    """A board that boots from a card of these layers, the newest first. key: of ssh."""
    with ExitStack() as stack:

        def prepare(machine: NamespaceBoard) -> None:
            shutil.copytree(camera.presses, machine.outside / "presses")
            stack.enter_context(_hub(machine.outside / "hub.sock"))

        machine = stack.enter_context(namespace_board(folder / "board", *layers, prepare=prepare))
        variables = {
            **machine.ssh,
            "release_wheelhouse": str(wheels),
            "fingertip_calibration": str(camera.calibration),
            "fingertip_capture": {
                "source": "recorded",
                "path": "/run/outside/presses",
                "loop": True,
                "timeout_ms": 1000,  # ten frames
            },
            "fingertip_bus": {"interface": "palpate", "channel": "/run/outside/hub.sock"},
        }
        playbooks = Playbooks(folder, key, {"fingertips": {"finger-1": variables}})
        bus = BusConfig(interface="palpate", channel=str(machine.outside / "hub.sock"))
        master = stack.enter_context(master_on(bus))
        yield FingertipBoard(machine, master, playbooks, folder)


@contextmanager
def _hub(socket: Path) -> Iterator[None]:
    with subprocess.Popen(
        [sys.executable, "-c", HUB, "hub", "--socket", socket], stderr=subprocess.PIPE, text=True
    ) as hub:
        assert hub.stderr is not None
        assert "listening" in hub.stderr.readline()
        socket.chmod(0o666)  # the board's user is another
        try:
            yield
        finally:
            hub.terminate()


def release_of(wheels: Path) -> str:
    """Return the name of the release in a wheelhouse for one Python."""
    (manifest,) = wheels.glob("cp*/MANIFEST.json")
    name: str = json.loads(manifest.read_text())["release"]
    return name
