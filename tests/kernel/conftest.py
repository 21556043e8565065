"""Fixtures of the tests inside a kernel: the daemon as a process, and waiting with a timeout."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import pytest

from kernel_guest.kernels import IN_A_KERNEL
from kernel_guest.links import PATIENCE_S
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.daemon.health import HealthReport
from palpate_edge.datasets.press_dataset import read_dataset


@pytest.fixture(params=IN_A_KERNEL)
def kernel(request: pytest.FixtureRequest) -> str:
    """The kernel in which a test runs; a test with this fixture runs once in each."""
    return str(request.param)


@pytest.fixture
def wait_until() -> Callable[..., None]:
    """Wait for a condition, for as long as a slow machine may need."""

    def wait(condition: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
        end_s = time.monotonic() + patience_s
        while not condition():
            assert time.monotonic() < end_s, "waited in vain"
            time.sleep(0.02)

    return wait


class FingertipProcess:
    """``palpate-edge run``, with its standard error and its health report."""

    def __init__(self, folder: Path, name: str, config: str) -> None:
        folder = folder / name
        folder.mkdir(exist_ok=True)
        self._said, self._health = folder / "said", folder / "health"
        (folder / "finger.toml").write_text(f'name = "{name}"\nhealth = "{self._health}"\n{config}')
        command = [
            sys.executable,
            "-m",
            "palpate_edge.cli.main",
            "run",
            "--config",
            str(folder / "finger.toml"),
        ]
        with self._said.open("wb") as said:
            self.process = subprocess.Popen(command, stdout=said, stderr=said)

    def said(self) -> str:
        return self._said.read_text()

    def health(self) -> HealthReport | None:
        """Return the health report, None before the first."""
        if not self._health.exists():
            return None
        return msgspec.json.decode(self._health.read_bytes(), type=HealthReport)

    def stop(self) -> int:
        """Send SIGTERM and return the exit status."""
        self.process.terminate()
        return self.process.wait(PATIENCE_S)


@pytest.fixture
def run_fingertip(
    tmp_path: Path, request: pytest.FixtureRequest
) -> Iterator[Callable[..., FingertipProcess]]:
    """Start a fingertip on a CAN interface. Its source is the drawn dataset in a loop, or `capture`.

    node: section [node] of its configuration. bus: further lines of [bus]. driver: bus.interface.
    """
    with ExitStack() as stack:

        def run(
            interface: str,
            capture: str = "",
            calibration: Path | None = None,
            name: str = "finger-1",
            node: str = "id = 16",
            bus: str = "",
            driver: str = "socketcan",
        ) -> FingertipProcess:
            if calibration is None:
                calibration = request.getfixturevalue("drawn_calibration_file")
                dataset = request.getfixturevalue("drawn_dataset")
                capture = f'source = "recorded"\npath = "{dataset}"\nloop = true\n'
            fingertip = FingertipProcess(
                tmp_path,
                name,
                f'[capture]\n{capture}[estimator]\ncalibration = "{calibration}"\n'
                f'[node]\n{node}\n[bus]\ninterface = "{driver}"\nchannel = "{interface}"\n{bus}',
            )
            stack.callback(fingertip.process.wait)
            stack.callback(fingertip.process.kill)
            return fingertip

        yield run


@pytest.fixture(scope="session")
def vga_calibration(another_dome: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the dataset of a rendered sensor with the size of the camera's image."""
    folder = tmp_path_factory.mktemp("vga")
    dataset = another_dome(width=640, height=480, focal_px=380.0).write(folder / "dome")
    save_calibration(calibrate(read_dataset(dataset)), folder / "vga.cal")
    return folder / "vga.cal"
