"""Recordings of the hand's page: listed, played, refused. test_console.py has them beside a running hand."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from dataclasses import replace

import msgspec
import pytest

from palpate_edge.web.broadcast import Broadcast
from palpate_host.common.command import CommandError
from palpate_host.console.hand_feed import HandFeed
from palpate_host.console.hand_scene import SceneMaker
from palpate_host.console.recordings import (
    Recordings,
    StartPlaying,
    StartRecording,
    StopPlaying,
    StopRecording,
)
from palpate_host.operator.client import NoHostError
from palpate_host.recording.bounds import Bounds
from palpate_host.recording.segments import SegmentedRecording

PATIENCE_S = 60.0


@pytest.fixture(scope="module")
def statuses(bench, table_4):
    virtual = bench.VirtualBench(*table_4)
    virtual.run(0.5)
    return virtual.statuses


class Page:
    """The events that an open page receives, and the recordings behind it."""

    def __init__(self, folder, config):
        self.broadcast = Broadcast()
        self.recordings = Recordings(folder, config, folder / "no-host", self.broadcast)
        self.shown = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def until(self, wanted, what):
        end_s = time.monotonic() + PATIENCE_S
        while not any(wanted(kind, value) for kind, value in list(self.shown)):
            assert time.monotonic() < end_s, what
            time.sleep(0.01)

    def close(self):
        self.recordings.close()
        self._ended.set()
        self._thread.join()

    def _listen(self):
        with self.broadcast.listen() as listener:
            while not self._ended.is_set():
                self.shown += [(kind, msgspec.json.decode(data)) for kind, data in listener.next(0.05)]


def write(folder, table_4, statuses):
    with SegmentedRecording(folder, *table_4, Bounds(10**8, 10**9)) as recording:
        recording.write(statuses[-1].time_us, [], statuses)


@pytest.fixture
def page(tmp_path, table_4, statuses):
    write(tmp_path / "grasp", table_4, statuses)
    with closing(Page(tmp_path, table_4[0])) as page:
        yield page


def test_a_recording_is_played_in_its_own_time_and_to_its_end(page, statuses):
    page.until(lambda kind, value: kind == "recordings" and value["names"] == ["grasp"], "not listed")
    assert page.recordings.run(StartPlaying("grasp")) == "playing grasp"
    page.until(lambda kind, value: kind == "recordings" and value["playing"], "not played")
    page.until(lambda kind, _value: kind == "hand", "not shown")
    page.shown[:] = [one for one in page.shown if one[0] == "hand"]
    page.until(lambda kind, value: kind == "recordings" and not value["playing"], "did not end")
    hands = [value for kind, value in page.shown if kind == "hand"]
    assert {hand["recording"] for hand in hands} == {"grasp"}
    by_time = {status.time_us: status for status in statuses}
    begun_us = statuses[0].time_us
    for hand in hands:
        status = by_time[hand["status"]["time_us"]]
        assert hand["status"]["joints"][0]["position_rad"] == status.joints[0].position_rad
        assert hand["at_s"] == pytest.approx((status.time_us - begun_us) / 1e6)


def test_while_a_recording_is_played_only_stop_reaches_the_hand(page, table_4, tmp_path):
    scenes = SceneMaker(table_4[0])
    with closing(HandFeed(tmp_path / "no-host", scenes, page.broadcast, page.recordings)) as feed:
        feed.run(b'{"command": "play", "name": "grasp"}')
        with pytest.raises(CommandError, match="stop playing first"):
            feed.run(b'{"command": "grasp"}')
        with pytest.raises(NoHostError):
            feed.run(b'{"command": "stop"}')
        feed.run(b'{"command": "play_no_more"}')
        with pytest.raises(NoHostError):
            feed.run(b'{"command": "grasp"}')
    assert not page.recordings.is_playing
    with pytest.raises(CommandError, match="nothing is being played"):
        page.recordings.run(StopPlaying())


def test_what_is_no_recording_of_this_hand_is_refused(page, table_4, statuses, tmp_path):
    for name in ("../grasp", "", "missing", str(tmp_path / "grasp")):
        with pytest.raises(CommandError, match="no finished recording"):
            page.recordings.run(StartPlaying(name))
    joints = (replace(statuses[0].joints[0], name="odd"), *statuses[0].joints[1:])
    write(tmp_path / "other", table_4, [replace(statuses[0], joints=joints)])
    page.recordings.run(StartPlaying("other"))
    page.until(lambda kind, value: kind == "recordings" and "has the joints odd" in value["failure"], "shown")
    with pytest.raises(NoHostError, match="no hand is running"):
        page.recordings.run(StartRecording())
    with pytest.raises(CommandError, match="nothing is being recorded"):
        page.recordings.run(StopRecording())
