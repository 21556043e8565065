"""What every refusal of the command line is: one line on stderr, a status that is not 0, nothing left."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from palpate_edge.cli.main import main as edge_main

HUB = "from palpate_bus.cli.main import bus; bus()"
PATIENCE_S = 60


def contents(folder: Path) -> dict[Path, bytes | None]:
    return {path: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.fixture
def refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Runs ``palpate-edge ARGS`` in this process and gives the text of its refusal.

    Standard error is taken at the descriptor, so that what a C library says there is seen as well; everything
    under tmp_path must be as it was before.
    """

    def run(*arguments: object) -> str:
        before = contents(tmp_path)
        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["palpate-edge", *map(str, arguments)])
        with pytest.raises(SystemExit) as leaving:
            edge_main()
        said = capfd.readouterr()
        assert leaving.value.code not in (0, None)
        assert said.out == ""
        assert said.err.startswith("error: ")
        assert said.err.count("\n") == 1, said.err
        assert contents(tmp_path) == before
        return said.err.removeprefix("error: ").strip()

    return run


@pytest.fixture
def edge() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts ``palpate-edge ARGS`` as a process; it is killed at the end of the test if it still runs."""
    started: list[subprocess.Popen[str]] = []

    def start(*arguments: object) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "palpate_edge.cli.main", *map(str, arguments)]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
        process.communicate()


@pytest.fixture
def start_hub(tmp_path: Path) -> Iterator[Callable[[], subprocess.Popen[str]]]:
    """Starts CAN hubs at tmp_path/hub.sock, as processes; they are ended at the end of the test."""
    started: list[subprocess.Popen[str]] = []

    def start() -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-c", HUB, "hub", "--socket", str(tmp_path / "hub.sock")],
            stderr=subprocess.PIPE,
            text=True,
        )
        started.append(process)
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        return process

    yield start
    for process in started:
        process.terminate()
        process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def hub(start_hub: Callable[[], subprocess.Popen[str]]) -> subprocess.Popen[str]:
    """A CAN hub at tmp_path/hub.sock, as a process."""
    return start_hub()


@pytest.fixture
def fingertip(tmp_path: Path, drawn_dataset: Path, drawn_calibration_file: Path) -> Callable[..., Path]:
    """Writes a fingertip's configuration, with (old, new) pairs of its text changed: the drawn dataset,
    played for ever, on the hub at tmp_path/hub.sock."""

    def write(*changes: tuple[str, str], name: str = "finger") -> Path:
        text = (
            f'name = "{name}"\nhealth = "{tmp_path / name}.health"\n'
            f'[capture]\nsource = "recorded"\npath = "{drawn_dataset}"\nloop = true\n'
            f'[estimator]\ncalibration = "{drawn_calibration_file}"\n'
            "[node]\nid = 16\n"
            f'[bus]\ninterface = "palpate"\nchannel = "{tmp_path / "hub.sock"}"\n'
        )
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / f"{name}.toml"
        path.write_text(text)
        return path

    return write
