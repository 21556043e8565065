"""A real daemon on a real hub, with a camera in shared memory that a test can freeze and a systemd that
listens."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import cv2
import numpy as np
import pytest

from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.capture.frame_ring import RingFormat, RingWriter

PATIENCE_S = 60.0
HUB = "from palpate_bus.cli.main import bus; bus()"
WATCHDOG_US = 1_500_000
FEED_US = WATCHDOG_US // 3
NODE = 0x10


class Camera:
    """Plays a folder of images for ever into a ring, 30 a second with noise, until it is frozen."""

    def __init__(self, ring: Path, frames: Path) -> None:
        self._images = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(frames.glob("*.png"))]
        height, width = self._images[0].shape
        self._writer = RingWriter(ring, RingFormat(width, height, 1, 4))
        self._frozen, self._covered, self._ended = threading.Event(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def freeze(self) -> None:
        self._frozen.set()

    def thaw(self) -> None:
        self._frozen.clear()

    def cover(self) -> None:
        """Show black frames from now on."""
        self._covered.set()

    def uncover(self) -> None:
        self._covered.clear()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self._writer.close()

    def _play(self) -> None:
        random = np.random.default_rng(0)
        sequence = 0
        while not self._ended.wait(1 / 30):
            sequence += 1
            if not self._frozen.is_set():
                image = self._images[sequence % len(self._images)].copy()
                if self._covered.is_set():
                    image[:] = 0
                image[:4] = random.integers(8, 16, (4, image.shape[1]))
                self._writer.write(image, sequence, time.monotonic_ns() // 1000)


class Rig:
    """The daemon and what surrounds it."""

    def __init__(
        self,
        folder: Path,
        dataset: Path,
        calibration: Path | None,
        stack: ExitStack,
        program: tuple[str, ...] = ("-m", "palpate_edge.cli.main"),
    ) -> None:
        """calibration: None for a fingertip that has none, and no file for parameters."""
        self.folder = folder
        self.config = folder / "finger.toml"
        self.config.write_text(
            f'name = "finger"\nhealth = "{folder / "finger.health"}"\n'
            f'[capture]\nsource = "shared_memory"\npath = "{folder / "ring"}"\n'
            + (f'[estimator]\ncalibration = "{calibration}"\n' if calibration else "")
            + f"[node]\nid = {NODE}\n"
            + (f'parameters = "{folder / "finger.parameters"}"\n' if calibration else "")
            + f'[bus]\ninterface = "palpate"\nchannel = "{folder / "hub.sock"}"\n'
            f'[record]\nfolder = "{folder / "recordings"}"\n'
        )
        self._stack = stack
        self.hub = self.start_hub()
        self.camera = Camera(folder / "ring", dataset / "frames")
        stack.callback(self.camera.close)
        self._systemd = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
        self._systemd.bind(str(folder / "notify"))
        self._systemd.setblocking(False)
        self._heard: dict[int, deque[bytes]] = {}
        self.notes: list[tuple[float, str]] = []
        environment = {"NOTIFY_SOCKET": str(folder / "notify"), "WATCHDOG_USEC": str(WATCHDOG_US)}
        self.process = subprocess.Popen(
            [sys.executable, *program, "run", "--config", str(self.config)],
            env={**os.environ, **environment},
            stderr=stack.enter_context((folder / "stderr").open("w")),
        )
        stack.callback(self._end)
        self.until(lambda: any("READY=1" in note for _, note in self.notes))

    def start_hub(self) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", HUB, "hub", "--socket", str(self.folder / "hub.sock")],
            stderr=subprocess.PIPE,
            text=True,
        )
        self._stack.callback(process.communicate)
        self._stack.callback(process.terminate)
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        return process

    def listen(self) -> Bus:
        """A master's bus; the node is started."""
        config = BusConfig(interface="palpate", channel=str(self.folder / "hub.sock"))
        bus = self._stack.enter_context(open_bus(config, "master"))
        bus.send([CanFrame(0x000, bytes([1, NODE]))])
        return bus

    def heard(self, bus: Bus, can_id: int, wanted: Callable[[bytes], bool]) -> bytes:
        """The next frame of this identifier that is wanted, among what was not asked for yet."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            for _, frame in bus.receive(0.1):
                self._heard.setdefault(frame.can_id, deque()).append(frame.data)
            waiting = self._heard.get(can_id, deque())
            while waiting:
                data = waiting.popleft()
                if wanted(data):
                    return data
        raise AssertionError(f"no such frame {can_id:03X}; {(self.folder / 'stderr').read_text()}")

    def starves(self) -> bool:
        """The watchdog is fed no more, once what was under way has been."""
        time.sleep(FEED_US / 1e6 + 0.3)
        self._hear_notes()
        begun_s = time.monotonic()
        time.sleep(WATCHDOG_US / 1e6)
        return self.feeds(begun_s) == 0

    def feeds(self, since_s: float) -> int:
        """How often the watchdog was fed since then."""
        self._hear_notes()
        return sum(note == "WATCHDOG=1" for at_s, note in self.notes if at_s >= since_s)

    def until(self, condition: Callable[[], bool]) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert self.process.poll() is None, (self.folder / "stderr").read_text()
            assert time.monotonic() < end_s, (self.folder / "stderr").read_text()
            time.sleep(0.02)
            self._hear_notes()

    def edge(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """Another ``palpate-edge`` beside it."""
        command = [sys.executable, "-m", "palpate_edge.cli.main", *arguments, "--config", str(self.config)]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)

    def _hear_notes(self) -> None:
        with suppress(BlockingIOError):
            while True:
                self.notes.append((time.monotonic(), self._systemd.recv(4096).decode()))

    def _end(self) -> None:
        self.process.terminate()
        self.process.wait(PATIENCE_S)


@pytest.fixture
def rig(tmp_path: Path, drawn_dataset: Path, drawn_calibration_file: Path) -> Iterator[Rig]:
    with ExitStack() as stack:
        yield Rig(tmp_path, drawn_dataset, drawn_calibration_file, stack)


@pytest.fixture
def second_rig(tmp_path: Path, drawn_dataset: Path, drawn_calibration_file: Path) -> Iterator[Rig]:
    """A rig beside `rig`, with a hub of its own."""
    folder = tmp_path / "second"
    folder.mkdir()
    with ExitStack() as stack:
        yield Rig(folder, drawn_dataset, drawn_calibration_file, stack)


SLOW_FSYNC = """
import os, time
fsync = os.fsync
os.fsync = lambda descriptor: (time.sleep(1.0), fsync(descriptor))
from palpate_edge.cli.main import main
main()
"""


@pytest.fixture
def slow_rig(tmp_path: Path, drawn_dataset: Path, drawn_calibration_file: Path) -> Iterator[Rig]:
    """A rig on a card whose every flush takes a second."""
    with ExitStack() as stack:
        yield Rig(tmp_path, drawn_dataset, drawn_calibration_file, stack, ("-c", SLOW_FSYNC))


@pytest.fixture
def bare_rig(tmp_path: Path, drawn_dataset: Path) -> Iterator[Rig]:
    """A rig whose fingertip has no calibration."""
    with ExitStack() as stack:
        yield Rig(tmp_path, drawn_dataset, None, stack)
