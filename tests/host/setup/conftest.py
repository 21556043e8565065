"""A hub in this process, with the hand of Table 4 on it: its simulated drives and three fingertip nodes."""

from __future__ import annotations

import io
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from tests.host.axes_hand import with_axes

from palpate_bus.hub.server import Hub
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_host.cli.setup import setup
from palpate_host.config.hand_config import HandConfig
from palpate_twin.drives.hand_drives import drives_of

SDO_REQUEST_ID, SERVE_US = 0x600, 50_000
TABLE_4_POSE_RAD = (0.0, 0.348, 1.221)


class HandOnHub:
    """The nodes of a hand, served in a thread. run: the command under test on their bus."""

    def __init__(self, folder: Path, config: HandConfig, data_bitrate: int | None = None) -> None:
        self.channel = folder / "hub"
        self.hub = Hub(self.channel, 1_000_000, 512, data_bitrate=data_bitrate)
        self.drives = {drive.slave.node_id: drive for drive in drives_of(config, TABLE_4_POSE_RAD)}
        self.tips = {
            node_id: FingertipNode(
                node_id,
                MethodCode.CORRECTED,
                "0123456789abcdef",
                has_led=node_id != 0x12,
                data_bitrate=data_bitrate,
            )
            for node_id in (finger.fingertip_node for finger in config.fingers)
        }
        self.led_levels: list[tuple[int, int]] = []  # node and level, whenever one is written
        self._are_on_bus, self._stopped = threading.Event(), threading.Event()
        self._threads = [threading.Thread(target=self.hub.run), threading.Thread(target=self._serve)]
        for thread in self._threads:
            thread.start()
        assert self._are_on_bus.wait(60), "the nodes did not reach the hub"

    def _serve(self) -> None:
        levels = {node_id: tip.led_set_point for node_id, tip in self.tips.items()}
        with open_bus(BusConfig(interface="palpate", channel=str(self.channel)), "nodes") as bus:
            self._are_on_bus.set()
            received: list[CanFrame] = []
            nodes = (*self.drives.values(), *self.tips.values())
            due_us = 0
            while not self._stopped.is_set():
                now_us = monotonic_us()
                called = {frame.can_id - SDO_REQUEST_ID for frame in received}
                for node in nodes:
                    if now_us >= due_us or node.slave.node_id in called:
                        bus.send(node.process(now_us, received).frames_out)
                due_us = now_us + SERVE_US if now_us >= due_us else due_us
                for node_id, tip in self.tips.items():
                    if tip.led_set_point != levels[node_id]:
                        levels[node_id] = tip.led_set_point
                        self.led_levels.append((node_id, levels[node_id]))
                received = [frame for _, frame in bus.receive(0.01)]

    def hold(self, node_id: int, turn_rad: float, axis: int = 0) -> None:
        """Turn a joint by hand and hold it there: its load pulls it to another angle."""
        plant = self.drives[node_id].motors[axis].plant
        held_rad = plant.parameters.grasp_rad + turn_rad
        plant.parameters = replace(plant.parameters, grasp_rad=held_rad)
        plant.position_rad = held_rad

    def run(self, *words: str, answers: Iterator[str] | None = None) -> Result:
        """Invoke ``palpate-host setup`` on this bus; `answers` yields lines, one when each is needed."""
        lines = None if answers is None else io.BufferedReader(Typed(answers))
        command = [*words, "--channel", str(self.channel), "--timeout", "2"]  # on a busy computer
        return CliRunner().invoke(setup, command, input=lines, catch_exceptions=False)

    def close(self) -> None:
        self._stopped.set()
        self._threads[1].join()
        self.hub.stop()
        self._threads[0].join()
        self.hub.close()


class Typed(io.RawIOBase):
    """Standard input of a person: a line is made when it is read."""

    def __init__(self, lines: Iterator[str]) -> None:
        self._lines = lines

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        text = next(self._lines, None)
        if text is None:
            return 0  # the end: a question more is an error, and does not wait for ever
        line = (text + "\n").encode()
        buffer[: len(line)] = line
        return len(line)


@pytest.fixture
def hand_on_hub(
    tmp_path: Path, table_4: tuple[HandConfig, object], monkeypatch: pytest.MonkeyPatch
) -> Iterator[HandOnHub]:
    monkeypatch.chdir(tmp_path)
    hand = HandOnHub(tmp_path, table_4[0])
    yield hand
    hand.close()


@pytest.fixture
def hand_on_fd_hub(
    tmp_path: Path, table_4: tuple[HandConfig, object], monkeypatch: pytest.MonkeyPatch
) -> Iterator[HandOnHub]:
    monkeypatch.chdir(tmp_path)
    hand = HandOnHub(tmp_path, table_4[0], data_bitrate=5_000_000)
    yield hand
    hand.close()


@pytest.fixture
def axes_on_fd_hub(
    tmp_path: Path, table_4: tuple[HandConfig, object], monkeypatch: pytest.MonkeyPatch
) -> Iterator[HandOnHub]:
    """The drives of each finger are three axes of one node."""
    monkeypatch.chdir(tmp_path)
    hand = HandOnHub(tmp_path, with_axes(table_4[0]), data_bitrate=5_000_000)
    yield hand
    hand.close()
