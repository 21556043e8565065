"""The feed of a hand's page beside a control socket: how soon the end of a host is shown."""

from __future__ import annotations

import threading
import time
from contextlib import closing

import msgspec
import pytest

from palpate_edge.web.broadcast import Broadcast
from palpate_host.console.hand_feed import HandFeed
from palpate_host.console.hand_scene import SceneMaker
from palpate_host.console.recordings import Recordings
from palpate_host.operator.server import OperatorSocket

SHOWN_WITHIN_S = 1.0
ROUNDS = 3  # the shortest time counts: a busy machine adds to each
PATIENCE_S = 60.0
ROUND_S = 0.01

pytestmark = pytest.mark.long


class AnsweringHost:
    """The control socket of a host, served by a thread until it hangs or dies."""

    def __init__(self, path):
        self._socket, self._hangs = OperatorSocket(path), threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def hang(self):
        self._hangs.set()
        self._thread.join()

    def die(self):
        self.hang()
        self._socket.close()

    def _serve(self):
        while not self._hangs.wait(ROUND_S):
            self._socket.serve(lambda _command: None, None)


def shown_after_s(listener, *, connected):
    """Return how long the page waits for the news that the host is or is not connected."""
    begun_s = time.monotonic()
    while time.monotonic() < begun_s + PATIENCE_S:
        for kind, data in listener.next(ROUND_S):
            if kind == "state" and msgspec.json.decode(data)["connected"] == connected:
                return time.monotonic() - begun_s
    raise AssertionError(f"connected = {connected} is not shown")


@pytest.mark.parametrize("end", [AnsweringHost.die, AnsweringHost.hang], ids=["dies", "hangs"])
def test_a_host_that_ends_is_shown_within_1_s_and_the_next_one_is_found(tmp_path, table_4, end):
    broadcast, path = Broadcast(), tmp_path / "host"
    recordings = Recordings(tmp_path, table_4[0], path, broadcast)
    waited_s = []
    with (
        closing(recordings),
        closing(HandFeed(path, SceneMaker(table_4[0]), broadcast, recordings)),
        broadcast.listen() as listener,
    ):
        for _ in range(ROUNDS):
            host = AnsweringHost(path)
            shown_after_s(listener, connected=True)
            end(host)
            waited_s.append(shown_after_s(listener, connected=False))
            host.die()
    assert min(waited_s) < SHOWN_WITHIN_S
