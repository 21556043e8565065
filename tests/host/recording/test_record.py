"""Recording beside a running hand: nothing disturbed, bounded, readable after a kill -9."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader
from tests.host.recording.test_live_server import TOPICS

from palpate_bus.logs.candump import LogRecord, read_log
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.common.errors import ConfigError
from palpate_host.common.command import Command
from palpate_host.common.status import HostStatus
from palpate_host.operator.server import OperatorSocket
from palpate_host.recording.bounds import Bounds
from palpate_host.recording.segments import SegmentedRecording
from palpate_host.recording.status_follower import StatusFollower
from palpate_host.recording.statuses import read_statuses
from palpate_host.recording.tick_stream import TickStream
from palpate_host.service.host import load_hand

PROJECT = Path(__file__).resolve().parents[3]
LOG = PROJECT / "tests" / "replay" / "demo.log.gz"
TABLE_4 = PROJECT / "host" / "palpate_host" / "models" / "table4.toml"
PATIENCE_S = 60.0


def wait_for(condition: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end_s, f"{what} did not come"
        time.sleep(0.02)


@contextmanager
def running(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    """A process of palpate-host; killed if it still runs at the end."""
    command = [sys.executable, "-m", "palpate_host.cli.main", *map(str, arguments)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture(scope="module")
def told() -> list[HostStatus]:
    """What the host of the recorded demo told, 200 ticks of it."""
    statuses = read_statuses(LOG, *load_hand(TABLE_4))
    return [next(statuses) for _ in range(200)]


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "hub.sock"
    with running("bus", "hub", "--socket", path) as process:
        assert process.stderr is not None and "listening" in process.stderr.readline()
        yield path


@pytest.fixture
def hand_toml(tmp_path: Path, hub: Path) -> Path:
    text = TABLE_4.read_text().replace('interface = "palpate"', f'interface = "palpate"\nchannel = "{hub}"')
    path = tmp_path / "hand.toml"
    path.write_text(text)
    return path


def serve(server: OperatorSocket, statuses: list[HostStatus]) -> None:
    """A host's ticks, from the moment that somebody follows them."""

    def obey(command: Command) -> None:
        raise AssertionError(f"{command} from a recorder")

    def is_followed() -> bool:
        server.serve(obey, None)
        return any(client.streams for client in server._clients.values())

    wait_for(is_followed, "the follower")
    for status in statuses:
        server.serve(obey, status)
        time.sleep(0.01)


def is_part_of(found: list[HostStatus], whole: list[HostStatus]) -> bool:
    """In their order, none twice; a slow reader may miss some."""
    remaining = iter(whole)
    return len(found) > len(whole) // 2 and all(status in remaining for status in found)


def mcap_topics(path: Path) -> dict[str, str]:
    """Return topic -> name of the schema of the messages that the mcap library finds in a file."""
    seen: dict[str, str] = {}
    with path.open("rb") as file, suppress(EndOfFile):
        for schema, channel, _ in NonSeekingReader(file).iter_messages(log_time_order=False):
            assert schema is not None
            seen[channel.topic] = schema.name
    return seen


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_what_bus_and_host_say_is_kept(
    tmp_path: Path, hand_toml: Path, hub: Path, told: list[HostStatus], end: signal.Signals
) -> None:
    """After SIGTERM everything; after SIGKILL all but the last second. The mcap library reads the MCAP."""
    folder, control = tmp_path / "recording", tmp_path / "host.sock"
    sent = [CanFrame(0x181, bytes([number])) for number in range(200)]
    with ExitStack() as stack:
        recorder = stack.enter_context(
            running("record", "--config", hand_toml, "-o", folder, "--socket", control)
        )
        assert recorder.stderr is not None and "record: listening" in recorder.stderr.readline()
        server = stack.enter_context(closing(OperatorSocket(control)))  # a host that comes later
        bus = stack.enter_context(open_bus(BusConfig(interface="palpate", channel=str(hub)), "test"))
        bus.send(sent)
        serve(server, told)
        log = folder / "000001.log"
        wait_for(lambda: log.read_text().count("181#") == 200, "the frames")
        if end is signal.SIGKILL:
            wait_for(lambda: told[-1] in read_statuses(folder, *load_hand(TABLE_4)), "the flush")
        else:
            time.sleep(0.5)
        recorder.send_signal(end)
        said, _ = recorder.communicate(timeout=PATIENCE_S)
    kept = list(read_statuses(folder, *load_hand(TABLE_4)))
    assert is_part_of(kept, told)
    assert [record.frame for record in read_log(log).records] == sent
    seen = mcap_topics(folder / "000001.mcap")
    assert {"/host/status", "/joint_states"} <= seen.keys()
    assert seen.items() <= TOPICS.items()
    if end is signal.SIGTERM:
        assert recorder.returncode == 0
        assert f"200 frames, {len(kept)} ticks in {folder}" in said


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


@pytest.mark.long
def test_a_host_that_starts_again_is_heard_again(tmp_path: Path, told: list[HostStatus]) -> None:
    path = tmp_path / "host.sock"
    with StatusFollower(path) as follower:
        wait_for(lambda: "no hand is running" in follower.failure, "a reason")
        for _ in range(2):
            server = OperatorSocket(path)
            serve(server, told[:20])
            found: list[HostStatus] = []
            wait_for(lambda found=found: bool(found.extend(follower.take()) or found), "a tick")
            time.sleep(0.2)
            server.close()
            assert is_part_of([*found, *follower.take()], told[:20])


def test_a_stream_gives_each_tick_once_and_returns_when_none_comes(
    tmp_path: Path, told: list[HostStatus]
) -> None:
    """Without a host, with one that sends, that is silent, and that has gone."""
    path = tmp_path / "host.sock"
    with closing(TickStream(path)) as stream:
        assert stream.next(0) is None and "no hand is running" in stream.failure
        with closing(OperatorSocket(path)) as server:
            ended = threading.Event()
            accepting = threading.Thread(target=accept_until, args=(server, ended))
            accepting.start()
            assert stream.next(0) is None and not stream.failure
            ended.set()
            accepting.join()
            serve(server, told[:20])
            assert [stream.next(0) for _ in range(20)] == told[:20]
            assert stream.next(0) is None and not stream.failure
        assert stream.next(0) is None and "has closed the connection" in stream.failure


def accept_until(server: OperatorSocket, ended: threading.Event) -> None:
    """Respond to requests without a status, as a host before its first tick."""
    while not ended.wait(0.001):
        server.serve(lambda _command: None, None)


def test_what_cannot_be_recorded_is_said(tmp_path: Path) -> None:
    hand = load_hand(TABLE_4)
    bounds = Bounds(piece_bytes=1_000_000, folder_bytes=10_000_000)
    SegmentedRecording(tmp_path / "r", *hand, bounds).close()
    with pytest.raises(ConfigError, match="already contains a recording"):
        SegmentedRecording(tmp_path / "r", *hand, bounds)
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be made"):
        SegmentedRecording(tmp_path / "file" / "r", *hand, bounds)
