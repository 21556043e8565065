"""Fixtures of the demo's tests: hand-made TPDOs, the packaged hand, processes found by their arguments."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.config.hand_config import HandConfig
from palpate_host.config.hand_reader import load
from palpate_twin.demo.run_folder import MODEL

PATIENCE_S = 60.0

# No test depends on how busy the machine is.
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")


@pytest.fixture(scope="session")
def hand_config() -> HandConfig:
    return load(MODEL)


@pytest.fixture(scope="session")
def tpdos() -> Callable[..., list[LogRecord]]:
    """Return a function that packs TPDO 1 to 3 of one frame by hand, as docs/bus.md describes them."""

    def make(
        node_id: int,
        sent_us: int,
        exposed_us: int,
        sequence: int,
        position_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
        normal_N: float = 0.0,
        flags: int = 4,
    ) -> list[LogRecord]:
        x, y, z = (round(100 * value) for value in position_mm)
        payloads = (
            struct.pack("<hhhh", x, y, z, round(1000 * normal_N)),
            struct.pack("<hhhBB", 0, 0, 0, flags, 255),
            struct.pack("<IHH", exposed_us % 2**32, sequence, 0),
        )
        return [
            LogRecord(sent_us - 2 + number, CanFrame(0x180 + 0x100 * number + node_id, data))
            for number, data in enumerate(payloads)
        ]

    return make


@pytest.fixture(scope="session")
def processes_of() -> Callable[[Path], dict[int, str]]:
    """Return a function that finds running processes whose command line contains a folder, by process id."""

    def find(folder: Path) -> dict[int, str]:
        found = {}
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except (FileNotFoundError, ProcessLookupError):
                continue
            if str(folder) in command:
                found[int(entry.name)] = command
        return found

    return find


@pytest.fixture(scope="session")
def eventually() -> Callable[[Callable[[], object]], None]:
    """Return a function that waits until a condition holds, and fails after 60 s."""

    def wait(condition: Callable[[], object]) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, "timed out"
            time.sleep(0.02)

    return wait
