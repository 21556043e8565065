"""Recording beside a running hand: nothing disturbed, bounded, readable after a kill -9."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import pytest

from palpate_edge.bus import BusConfig, open_bus
from palpate_edge.can_frame import CanFrame
from palpate_edge.errors import ConfigError
from palpate_host.bus.candump import LogRecord, read_log
from palpate_host.host import load_hand
from palpate_host.recording.segments import Bounds, SegmentedRecording
from palpate_host.recording.status_listener import StatusListener
from palpate_host.recording.statuses import read_statuses
from palpate_host.status import HostStatus

PROJECT = Path(__file__).resolve().parents[2]
LOG = PROJECT / "tests" / "replay" / "demo.log.gz"
TABLE_4 = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
PATIENCE_S = 60.0


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not come"
        time.sleep(0.02)


def start(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "palpate_host.cli", *map(str, arguments)]
    return subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


@pytest.fixture(scope="module")
def told() -> list[HostStatus]:
    """What the host of the recorded demo told, 200 ticks of it."""
    statuses = read_statuses(LOG, *load_hand(TABLE_4))
    return [next(statuses) for _ in range(200)]


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "hub.sock"
    process = start("bus", "hub", "--socket", path)
    assert process.stderr is not None and "listening" in process.stderr.readline()
    yield path
    process.terminate()
    process.communicate(timeout=PATIENCE_S)


@pytest.fixture
def hand_toml(tmp_path: Path, hub: Path) -> Path:
    text = TABLE_4.read_text().replace('interface = "palpate"', f'interface = "palpate"\nchannel = "{hub}"')
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_what_bus_and_host_say_is_kept(
    tmp_path: Path, hand_toml: Path, hub: Path, told: list[HostStatus], end: signal.Signals
) -> None:
    """After SIGTERM everything; after SIGKILL all but the last second."""
    folder = tmp_path / "recording"
    recorder = start("record", "--config", hand_toml, "-o", folder)
    assert recorder.stderr is not None and "record: listening" in recorder.stderr.readline()
    lines = [msgspec.json.encode(status) + b"\n" for status in told]
    sent = [CanFrame(0x181, bytes([number])) for number in range(200)]
    with (
        open_bus(BusConfig(interface="palpate", channel=str(hub)), "test") as bus,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as host,
    ):
        host.connect(str(folder / "status.sock"))
        for frame, line in zip(sent, lines, strict=True):
            bus.send([frame])
            host.sendall(line)
        host.sendall(lines[0][:50])  # the host is cut off in a line
        log = folder / "000001.log"
        if end is signal.SIGKILL:
            wait_for(lambda: log.read_text().count("181#") == 200, "the flush")
            wait_for(lambda: len(list(read_statuses(folder, *load_hand(TABLE_4)))) == 200, "the flush")
        else:
            time.sleep(0.5)
        recorder.send_signal(end)
        said, _ = recorder.communicate(timeout=PATIENCE_S)
    if end is signal.SIGTERM:
        assert recorder.returncode == 0
        assert f"200 frames, 200 ticks in {folder}" in said
        assert not (folder / "status.sock").exists()
    assert [record.frame for record in read_log(log).records] == sent
    assert list(read_statuses(folder, *load_hand(TABLE_4))) == told


def test_the_folder_stays_within_its_bounds(tmp_path: Path, told: list[HostStatus]) -> None:
    """Pieces of 40 kB, 200 kB in all, of some 1 MB that came; the newest ticks are those that are kept."""
    bounds = Bounds(piece_bytes=40_000, folder_bytes=200_000)
    record = LogRecord(1_700_000_000_000_000, CanFrame(0x181, bytes(8)))
    with SegmentedRecording(tmp_path / "r", *load_hand(TABLE_4), bounds) as recording:
        for second in range(100):
            recording.write(second * 1_000_000, [record] * 100, told[2 * second : 2 * second + 2])
            size = sum(path.stat().st_size for path in (tmp_path / "r").iterdir())
            assert size < bounds.folder_bytes + bounds.piece_bytes
        assert recording.pieces > 6
    kept = list(read_statuses(tmp_path / "r", *load_hand(TABLE_4)))
    assert 10 < len(kept) < 200
    assert kept == told[-len(kept) :]


def test_a_host_that_starts_again_is_heard_again(tmp_path: Path, told: list[HostStatus]) -> None:
    path = tmp_path / "status.sock"
    line = msgspec.json.encode(told[0]) + b"\n"
    with StatusListener(path) as listener:
        for _ in range(2):
            with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as host:
                host.connect(str(path))
                host.sendall(line + b"no status\n" + line[:10])
                assert listener.take() == [told[0]]
        assert listener.take() == []
        assert listener.garbled == 2


def test_what_cannot_be_recorded_is_said(tmp_path: Path) -> None:
    hand = load_hand(TABLE_4)
    bounds = Bounds(piece_bytes=1_000_000, folder_bytes=10_000_000)
    SegmentedRecording(tmp_path / "r", *hand, bounds).close()
    with pytest.raises(ConfigError, match="holds a recording already"):
        SegmentedRecording(tmp_path / "r", *hand, bounds)
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be made"):
        SegmentedRecording(tmp_path / "file" / "r", *hand, bounds)
    with StatusListener(tmp_path / "s"), pytest.raises(ConfigError, match="another process listens there"):
        StatusListener(tmp_path / "s")
    stale = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    stale.bind(str(tmp_path / "stale"))
    stale.close()
    StatusListener(tmp_path / "stale").close()
