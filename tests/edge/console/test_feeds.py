"""Both feeds of a fingertip's page in this process: a daemon's watch socket, a recording as the camera."""

from __future__ import annotations

import base64
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest
from tests.edge.console.finger_toml import recorded_finger_toml
from tests.health_of_a_fingertip import REPORT as HEALTHY

from palpate_edge.capture.frame_ring import RingFormat, RingWriter
from palpate_edge.common.contact import refused_contact
from palpate_edge.common.errors import PalpateError
from palpate_edge.console import daemon_feed
from palpate_edge.console.camera_feed import CameraFeed
from palpate_edge.console.daemon_feed import DaemonFeed, connect_daemon
from palpate_edge.console.feed import NewestPicture, PageCommands
from palpate_edge.console.open_feed import open_feed
from palpate_edge.daemon.config import read_config
from palpate_edge.daemon.watching.watch_messages import (
    BeadsShown,
    WatchedFingertip,
    WatchedFrame,
    WatchedHealth,
    WatchRefusedError,
    WatchRequest,
)
from palpate_edge.daemon.watching.watch_socket import WatchSocket
from palpate_edge.web.broadcast import Broadcast, Listener

pytestmark = pytest.mark.long

PATIENCE_S = 30.0
LIVE = {"connected": True, "text": "live, from the daemon"}
REPORT = msgspec.structs.replace(
    HEALTHY,
    recording="/tmp/kept",
    camera=msgspec.structs.replace(HEALTHY.camera, fps=29.5, dropped=3),
)


class Page:
    """A page that keeps the newest event of each kind, and all texts of the state."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self.newest: dict[str, Any] = {}
        self.states: list[str] = []

    def until(self, condition: Callable[[], Any], what: str = "nothing") -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < end_s, f"{what}: {self.newest.get('state')}"
            for kind, data in self._listener.next(0.05):
                self.newest[kind] = json.loads(data)
                if kind == "state":
                    self.states.append(self.newest[kind]["text"])

    def until_state(self, part: str) -> None:
        self.until(lambda: any(part in text for text in self.states), part)


class WatchedDaemon:
    """A daemon's end of the watch socket, served by a thread; it shows one picture again and again."""

    def __init__(self, folder, image, method="paper") -> None:
        self.image, self.requests = image, []
        self.refusal = ""
        self._ring = folder / "finger.pictures"
        hello = WatchedFingertip("finger", method, 30.0, False, True, str(self._ring))
        self.socket = WatchSocket(folder / "finger.watch", hello, self._execute)
        self.socket.send(WatchedHealth(REPORT))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        self.socket.close()

    def _execute(self, request: WatchRequest) -> str:
        if self.refusal:
            raise WatchRefusedError(self.refusal)
        self.requests.append((request.command, request.level))
        return f"{request.command} done"

    def _serve(self) -> None:
        height, width = self.image.shape
        with ExitStack() as stack:
            ring, sequence = None, 0
            while not self._ended.wait(0.01):
                self.socket.serve()
                if not self.socket.is_watched:
                    continue
                if ring is None:
                    ring = stack.enter_context(closing(RingWriter(self._ring, RingFormat(width, height, 1))))
                sequence += 1
                ring.write(self.image, sequence, 1000 * sequence)
                contact = refused_contact(sequence, 1000 * sequence, "too dark", 84, 85)
                beads = BeadsShown([(1.0, 2.0)], [(1.5, 2.0)], [])
                self.socket.send(WatchedFrame(contact, 12.5, beads))


@pytest.fixture(scope="module")
def untouched(drawn_dome):
    """The drawn sensor without contact (240, 320)."""
    return cv2.cvtColor(drawn_dome.picture(drawn_dome.beads_mm(), seed=1), cv2.COLOR_BGR2GRAY)


@contextmanager
def followed(connect: Callable[[], socket.socket | None], widest_px=640) -> Iterator[tuple[DaemonFeed, Page]]:
    """A daemon's feed with one page."""
    broadcast = Broadcast()
    with (
        closing(DaemonFeed("finger", 1000, connect, broadcast, NewestPicture(), widest_px)) as feed,
        broadcast.listen() as listener,
    ):
        yield feed, Page(listener)


@contextmanager
def page_of(daemon, folder, **options):
    with closing(daemon), followed(lambda: connect_daemon([folder / "finger.watch"]), **options) as feed:
        yield feed


def test_a_daemons_frames_and_health_reach_the_page(tmp_path, untouched):
    with page_of(WatchedDaemon(tmp_path, untouched), tmp_path, widest_px=160) as (_, page):
        page.until(lambda: {"frame", "health", "fingertip", "state"} <= page.newest.keys())
        frame, health = page.newest["frame"], page.newest["health"]
        assert page.newest["state"] == LIVE
        assert page.newest["fingertip"]["outer_radius_mm"] == 30.0
    assert (frame["contact"]["reason"], frame["latency_ms"]) == ("too dark", 12.5)
    assert frame["beads"] == {"position_px": [[1.0, 2.0]], "rest_px": [[1.5, 2.0]], "lost": []}
    assert frame["size_px"] == [320, 240]
    shown = cv2.imdecode(np.frombuffer(base64.b64decode(frame["jpeg"]), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert shown.shape == (120, 160)
    half = cv2.resize(untouched, (160, 120), interpolation=cv2.INTER_AREA)
    assert np.abs(shown.astype(float) - half).mean() < 3.0
    assert (health["fps"], health["dropped"], health["recording"]) == (29.5, 3, "/tmp/kept")
    parts = {row["part"]: row["verdict"] for row in health["rows"]}
    assert (parts["bus"], parts["temperature"], parts["calibration"]) == ("ok", "absent", "ok")
    assert "finger.cal, paper" in [row["value"] for row in health["rows"]]


def test_commands_go_to_the_daemon_and_its_refusal_comes_back(tmp_path, untouched):
    daemon = WatchedDaemon(tmp_path, untouched)
    with page_of(daemon, tmp_path) as (feed, page):
        page.until_state("live")
        commands = PageCommands(feed, NewestPicture(), tmp_path / "snapshots")
        assert commands.run(b'{"command": "light", "level": 9}') == "light done"
        assert commands.run(b'{"command": "record"}') == "record done"
        assert daemon.requests == [("light", 9), ("record", 0)]
        daemon.refusal = "no LED ring"
        with pytest.raises(WatchRefusedError, match=r"^no LED ring$"):
            commands.run(b'{"command": "identify"}')
        with pytest.raises(WatchRefusedError, match="end it and this console"):
            commands.run(b'{"command": "guide", "action": "start"}')
        with pytest.raises(WatchRefusedError, match="no picture is shown now"):
            commands.run(b'{"command": "snapshot"}')


def test_pictures_are_requested_only_while_a_page_is_open(tmp_path, untouched):
    daemon, broadcast = WatchedDaemon(tmp_path, untouched), Broadcast()
    connect = lambda: connect_daemon([tmp_path / "finger.watch"])  # noqa: E731
    with closing(daemon), closing(DaemonFeed("finger", 1000, connect, broadcast, NewestPicture(), 640)):
        with broadcast.listen() as listener:
            page = Page(listener)
            page.until(lambda: "frame" in page.newest)
            assert daemon.socket.is_watched
        end_s = time.monotonic() + PATIENCE_S
        while daemon.socket.is_watched:
            assert time.monotonic() < end_s
            time.sleep(0.01)


def test_without_a_calibration_blobs_are_shown(tmp_path, untouched):
    with page_of(WatchedDaemon(tmp_path, untouched, method="none"), tmp_path) as (_, page):
        page.until(lambda: "frame" in page.newest)
        assert 70 <= len(page.newest["frame"]["beads"]["position_px"]) <= 95


def test_a_daemon_that_ends_is_shown_and_the_next_one_followed(tmp_path, untouched, monkeypatch):
    monkeypatch.setattr(daemon_feed, "RETRY_S", 0.02)
    with followed(lambda: connect_daemon([tmp_path / "finger.watch"])) as (feed, page):
        page.until_state("no daemon of finger runs: palpate-edge run --config FILE starts one")
        with pytest.raises(WatchRefusedError, match="no daemon of finger runs: start it first"):
            feed.execute("tare", 0)
        for _ in range(2):
            page.states.clear()
            with closing(WatchedDaemon(tmp_path, untouched)):
                page.until_state("live, from the daemon")
                page.newest.pop("frame", None)
                page.until(lambda: "frame" in page.newest)
            page.until_state("no daemon of finger runs")


@contextmanager
def pair() -> Iterator[tuple[socket.socket, Callable[[], socket.socket | None]]]:
    """The daemon's end of a connection, and what opens the feed's end, once."""
    far, near = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    near.settimeout(0.02)
    ends = [near]
    with far:
        yield far, lambda: ends.pop() if ends else None


def test_a_daemon_of_another_version_is_told(monkeypatch):
    monkeypatch.setattr(daemon_feed, "RETRY_S", 10.0)  # the text stays meanwhile
    with pair() as (far, connect), followed(connect) as (_, page):
        far.send(b'{"type": "greeting"}')
        page.until_state("the daemon is of another version: restart it and this console")


def test_a_daemon_that_has_ended_is_told(monkeypatch):
    monkeypatch.setattr(daemon_feed, "RETRY_S", 10.0)
    with pair() as (far, connect), followed(connect) as (_, page):
        page.until_state("live")
        far.close()
        page.until_state("the daemon of finger has ended: see its log; this page reconnects")


def test_a_silent_daemon_is_told_once_and_when_it_is_back(monkeypatch):
    monkeypatch.setattr(daemon_feed, "SILENT_S", 0.1)
    monkeypatch.setattr(daemon_feed, "ANSWER_S", 0.05)
    with pair() as (far, connect), followed(connect) as (feed, page):
        page.until_state("the daemon of finger does not answer: see its log")
        with pytest.raises(WatchRefusedError, match="does not answer"):
            feed.execute("tare", 0)
        page.states.clear()
        far.send(msgspec.json.encode(WatchedHealth(REPORT)))
        page.until_state("live, from the daemon")


def test_a_socket_on_which_nobody_listens_is_no_daemon(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as bound:
        bound.bind(str(tmp_path / "left.watch"))
    assert connect_daemon([tmp_path / "missing.watch", tmp_path / "left.watch"]) is None


def configuration(folder, dataset, loop):
    return read_config(recorded_finger_toml(folder, dataset, loop=loop))


@pytest.fixture
def camera(tmp_path, drawn_dome, untouched):
    """Start a camera feed on five pictures without a calibration: (feed, page, newest picture)."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    for number in range(5):
        cv2.imwrite(str(folder / f"{number}.png"), untouched)
    with ExitStack() as stack:

        def start(loop=True):
            broadcast, picture = Broadcast(), NewestPicture()
            config = configuration(tmp_path, folder, loop)
            page = Page(stack.enter_context(broadcast.listen()))
            feed = CameraFeed(config, lambda _line: None, broadcast, picture, 640)
            stack.callback(feed.close)
            return feed, page, picture

        yield start


def test_a_camera_of_its_own_shows_blobs_and_takes_commands(camera, tmp_path, untouched):
    feed, page, picture = camera()
    page.until(lambda: {"frame", "health"} <= page.newest.keys())
    frame = page.newest["frame"]
    assert 70 <= len(frame["beads"]["position_px"]) <= 95 and not frame["contact"]["valid"]
    parts = {row["part"]: row["verdict"] for row in page.newest["health"]["rows"]}
    assert (parts["bus"], parts["calibration"], page.newest["health"]["nmt_state"]) == ("absent", "warn", "")
    commands = PageCommands(feed, picture, tmp_path / "snapshots")
    saved = commands.run(b'{"command": "snapshot"}').removeprefix("snapshot ")
    np.testing.assert_array_equal(cv2.imread(saved, cv2.IMREAD_GRAYSCALE), untouched)
    assert commands.run(b'{"command": "record"}') == f"recording under {tmp_path / 'recordings'}"
    page.until(lambda: page.newest["health"]["recording"], "no recording")
    assert commands.run(b'{"command": "record_no_more"}') == "recording ends"
    page.until(lambda: not page.newest["health"]["recording"], "the recording goes on")
    assert list((tmp_path / "recordings").glob("*/frames.csv"))
    for refused in ("tare", "light", "identify", "guide"):
        with pytest.raises(PalpateError):
            commands.run(json.dumps({"command": refused}).encode())


def test_the_end_of_a_recording_is_shown(camera):
    _, page, _ = camera(loop=False)
    page.until_state("the recording has ended")
    assert not page.newest["state"]["connected"]


def test_the_feed_is_the_daemons_when_one_runs_else_the_cameras(camera, tmp_path, untouched):
    config, lines = configuration(tmp_path, tmp_path / "pictures", loop=True), []
    with closing(open_feed(config, Broadcast(), NewestPicture(), lines.append)) as feed:
        assert isinstance(feed, CameraFeed)
    with closing(WatchedDaemon(tmp_path, untouched)):
        (tmp_path / "finger.watch").rename(tmp_path / "alone.watch")
        with closing(open_feed(config, Broadcast(), NewestPicture(), lines.append)) as feed:
            assert isinstance(feed, DaemonFeed)
    assert lines == [
        "alone: no daemon runs; this console takes the camera, without the bus",
        "alone: a daemon runs and has the camera",
    ]
