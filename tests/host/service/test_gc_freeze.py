"""In the loops that go on for days the garbage collector walks nothing of what start-up built."""

from __future__ import annotations

import gc
import subprocess
import sys
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.daemon import daemon
from palpate_edge.daemon.config import FingertipConfig
from palpate_host.service import host

HUB = "from palpate_bus.cli.main import bus; bus()"
LEAST_OBJECTS = 10_000  # the modules that host and daemon import make more


class Watched:
    """How many objects the collector passed over, at most, while the block ran."""

    most_frozen = 0


@contextmanager
def watched() -> Iterator[Watched]:
    seen, ended = Watched(), threading.Event()

    def watch() -> None:
        while not ended.wait(0.01):
            seen.most_frozen = max(seen.most_frozen, gc.get_freeze_count())

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield seen
    finally:
        ended.set()
        thread.join()


@pytest.fixture
def hub(tmp_path: Path) -> Iterator[Path]:
    path = tmp_path / "hub.sock"
    command = [sys.executable, "-c", HUB, "hub", "--socket", str(path)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert "listening" in process.stderr.readline()
        yield path
        process.terminate()


def test_what_was_there_is_passed_over_and_what_comes_is_collected():
    class Ring:
        def __init__(self) -> None:
            self.me = self

    built = Ring()
    with long_lived():
        assert not any(one is built for one in gc.get_objects())
        Ring()
        assert gc.collect() > 0
    assert any(one is built for one in gc.get_objects())
    assert gc.get_freeze_count() == 0


@pytest.mark.long
def test_the_host_loops_so(bench, tmp_path):
    text = bench.TABLE_4.read_text()
    config = tmp_path / "hand.toml"
    config.write_text(
        text.replace('interface = "palpate"', f'interface = "virtual"\nchannel = "{uuid.uuid4().hex}"')
    )
    with watched() as seen:
        host.run(config, host.Options(duration_s=0.5))
    assert seen.most_frozen > LEAST_OBJECTS
    assert gc.get_freeze_count() == 0


def test_the_fingertip_loops_so(tmp_path, hub, drawn_dataset, drawn_calibration_file):
    config = {
        "name": "finger",
        "health": str(tmp_path / "health"),
        "capture": {"source": "recorded", "path": str(drawn_dataset / "frames")},
        "estimator": {"calibration": str(drawn_calibration_file)},
        "node": {"id": 0x10},
        "bus": {"interface": "palpate", "channel": str(hub)},
        "record": {"folder": str(tmp_path)},
    }
    with watched() as seen:
        daemon.run(msgspec.convert(config, FingertipConfig))
    assert seen.most_frozen > LEAST_OBJECTS
    assert gc.get_freeze_count() == 0
