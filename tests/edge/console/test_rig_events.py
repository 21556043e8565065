"""The events of a press-rig run's page, and its only command, in this process."""

from __future__ import annotations

import http.client
import json
import threading
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.edge.console.finger_toml import recorded_finger_toml

from palpate_edge.common.errors import RigError
from palpate_edge.common.frame import Frame
from palpate_edge.console import rig_page
from palpate_edge.console.rig_page import RigPage, serve_rig
from palpate_edge.daemon.config import read_config
from palpate_edge.press_rig.dome_place import DomePlace
from palpate_edge.press_rig.journal import PressRecord
from palpate_edge.web.broadcast import Broadcast

PLACE = DomePlace((100.0, 90.0, 20.0), 35.0)


def core(force_N=None, target_mm=None):
    target = None if target_mm is None else np.array(target_mm, dtype=float)
    return SimpleNamespace(force_N=force_N, target_mm=target)


def record(number, outward=(0.0, 0.0, 1.0)):
    return PressRecord(number, f"{number}.png", "train", 1.0, outward, 1.0, (0.0, 0.0), 0.5 + number, 0.01)


class Watched:
    """A page of a run of 20 frames with one listener. now_s: of its clock."""

    def __init__(self, listener, page, stopped, clock):
        self.page, self.stopped, self._listener, self._clock = page, stopped, listener, clock

    def events(self) -> dict[str, Any]:
        return {kind: json.loads(data) for kind, data in self._listener.next(0.0)}

    def step(self, core=None, place=None, records=(), lines=(), after_s=0.0):
        self._clock[0] += after_s
        self.page.step(core or globals()["core"](), place, tuple(records), list(lines))
        return self.events()


@pytest.fixture
def watched(monkeypatch):
    clock, broadcast, stopped = [50.0], Broadcast(), threading.Event()
    monkeypatch.setattr(rig_page.time, "monotonic", lambda: clock[0])
    page = RigPage(20, broadcast, stopped)
    with broadcast.listen() as listener:
        yield Watched(listener, page, stopped, clock)


def test_progress_is_published_ten_times_a_second_and_with_each_line(watched):
    first = watched.step()
    assert first["state"] == {"connected": True, "text": "live, from the run"}
    unknown = {"force_N": None, "ball_mm": None, "reach_mm": None}
    assert first["rig"] == {"done": 0, "total": 20, "text": "starting", **unknown}
    assert watched.step(core(1.5), after_s=0.09) == {}
    assert watched.step(core(1.5), after_s=0.02)["rig"]["force_N"] == 1.5
    told = watched.step(lines=["looking for the dome", "touched"])
    assert told["rig"]["text"] == "touched"
    assert watched.step(after_s=0.2)["rig"]["text"] == "touched"


def test_the_ball_is_relative_to_the_dome_once_both_are_known(watched):
    watched.step()
    target = (101.234, 89.0, 55.006)
    assert watched.step(core(target_mm=target), after_s=1.0)["rig"]["ball_mm"] is None
    assert watched.step(core(), PLACE, after_s=1.0)["rig"]["reach_mm"] is None
    known = watched.step(core(target_mm=target), PLACE, after_s=1.0)["rig"]
    assert (known["ball_mm"], known["reach_mm"]) == ([1.23, -1.0, 35.01], 35.0)


def test_presses_are_published_when_there_are_more_without_those_of_the_air(watched):
    assert watched.step()["presses"] == []
    both = watched.step(records=[record(0), record(1, None)])
    assert both["presses"] == [{"outward": [0.0, 0.0, 1.0], "weight_N": 0.5}]
    assert both["rig"]["done"] == 2
    assert "presses" not in watched.step(records=[record(0), record(1, None)], after_s=1.0)


def test_pictures_have_their_beads_and_wait_for_a_page(watched, drawn_dome):
    image = drawn_dome.picture(drawn_dome.beads_mm(), seed=1)
    watched.page.show(Frame(image, 1_000_000, 7, "7"))
    watched.page.show(Frame(image, 1_050_000, 8, "8"))  # too soon
    frame = watched.events()["frame"]
    assert (frame["sequence"], frame["size_px"]) == (7, [320, 240])
    assert 70 <= len(frame["beads"]["position_px"]) <= 95
    broadcast = Broadcast()
    RigPage(20, broadcast, threading.Event()).show(Frame(image, 0, 1, "1"))
    with broadcast.listen() as listener:
        assert [kind for kind, _ in listener.next(0.0)] == ["state"]


@pytest.mark.parametrize("body", [b'{"command": "go"}', b'{"command": 1}', b"\xff", b"[]", b'{"a": "stop"}'])
def test_a_run_has_stop_only(watched, body):
    with pytest.raises(RigError, match="has stop only"):
        watched.page.run(body)
    assert not watched.stopped.is_set()
    assert watched.page.run(b'{"command": "stop"}').startswith("stop: the ball is lifted off")
    assert watched.stopped.is_set()


def test_the_page_is_served_during_a_run_and_its_stop_needs_the_token(tmp_path):
    path = recorded_finger_toml(tmp_path, tmp_path, "rigged", loop=False)
    stopped, lines = threading.Event(), []
    with serve_rig(read_config(path), 0, 20, stopped, lines.append):
        address = next(line for line in lines if "token=" in line)
        port, token = int(address.split(":")[3].split("/")[0]), address.split("token=")[1]
        for bearer, status in (("wrong", 401), (token, 200)):
            assert not stopped.is_set()
            with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as connection:
                headers = {"Content-Type": "application/json", "Authorization": f"Bearer {bearer}"}
                connection.request("POST", "/command", b'{"command": "stop"}', headers)
                assert connection.getresponse().status == status
    assert stopped.is_set()
