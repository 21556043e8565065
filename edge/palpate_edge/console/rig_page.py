"""The page of a press-rig run: the live picture with beads, progress, the force on the scale, and Stop."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import numpy as np

from palpate_edge.common.errors import RigError
from palpate_edge.common.frame import Frame
from palpate_edge.console.events import ConsoleState
from palpate_edge.console.fingertip_pages import PAGE, page_token
from palpate_edge.console.pictures import LooseBeads, jpeg_of
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.watching.view_tap import PictureRate
from palpate_edge.daemon.watching.watch_messages import BeadsShown
from palpate_edge.press_rig.dome_place import DomePlace
from palpate_edge.press_rig.journal import PressRecord
from palpate_edge.press_rig.rig_core import RigCore
from palpate_edge.web.broadcast import Broadcast
from palpate_edge.web.pages import page_files
from palpate_edge.web.serving import serve_page

PERIOD_S = 0.1
CTRL_C = "Ctrl-C lifts the ball off and ends the run"


class RigPicture(msgspec.Struct, frozen=True):
    """A picture of the run's camera. size_px: width and height that `beads` refer to."""

    sequence: int
    beads: BeadsShown
    size_px: tuple[int, int]
    jpeg: bytes


class RigProgress(msgspec.Struct, frozen=True):
    """The run. done, total: frames of the plan; text: what it does, or its last line. force_N: on the scale
    since the last tare. ball_mm: from the dome's centre to the ball's, in the printer's axes; reach_mm: its
    length at the first touch. None before they are known."""

    done: int
    total: int
    text: str
    force_N: float | None
    ball_mm: tuple[float, float, float] | None
    reach_mm: float | None


class PressPlace(msgspec.Struct, frozen=True):
    """A press that was taken: its outward normal in the printer's axes, and its weight."""

    outward: tuple[float, float, float]
    weight_N: float


class RigPage:
    """Publishes a run. `show` is for the camera's thread, the other methods are for the run's."""

    def __init__(self, total: int, broadcast: Broadcast, stopped: threading.Event) -> None:
        self._total, self._broadcast, self._stopped = total, broadcast, stopped
        self._rate, self._beads = PictureRate(), LooseBeads()
        self._text, self._due_s, self._shown = "starting", 0.0, -1
        broadcast.publish("state", ConsoleState(True, "live, from the run"))

    def show(self, frame: Frame) -> None:
        """Publish a picture, at most ten a second, while a page is open."""
        if self._broadcast.listeners and self._rate.takes(frame.exposed_at_us):
            height, width = frame.image.shape[:2]
            beads = self._beads.find(frame.image)
            picture = RigPicture(frame.sequence, beads, (width, height), jpeg_of(frame.image))
            self._broadcast.publish("frame", picture)

    def step(
        self, core: RigCore, place: DomePlace | None, records: tuple[PressRecord, ...], lines: list[str]
    ) -> None:
        """Publish the run's progress, ten times a second, and the presses when there are more.

        place: of the dome, None until it is found. lines: new ones of the run.
        """
        self._text = lines[-1] if lines else self._text
        is_new = len(records) != self._shown
        if is_new:
            self._shown = len(records)
            taken = [PressPlace(one.outward, one.weight_N) for one in records if one.outward is not None]
            self._broadcast.publish("presses", taken)
        if is_new or lines or time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + PERIOD_S
            ball_mm = reach_mm = None
            if place is not None and core.target_mm is not None:
                x, y, z = (core.target_mm - np.array(place.centre_mm)).round(2).tolist()
                ball_mm, reach_mm = (x, y, z), place.reach_mm
            news = RigProgress(self._shown, self._total, self._text, core.force_N, ball_mm, reach_mm)
            self._broadcast.publish("rig", news)

    def run(self, body: bytes) -> str:
        """Carry out a page's command, which can only be ``stop``. Raises RigError for any other."""
        try:
            command = msgspec.json.decode(body, type=dict[str, str])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            command = {}
        if command != {"command": "stop"}:
            raise RigError("not a command: the page of a run has stop only")
        self._stopped.set()
        return "stop: the ball is lifted off; repeat the command to go on"


@contextmanager
def serve_rig(
    config: FingertipConfig, port: int, total: int, stopped: threading.Event, report: Callable[[str], None]
) -> Iterator[RigPage]:
    """Serve the page of a run on 127.0.0.1 during the block; `report` takes the lines with its address.

    total: frames of the plan. stopped: set by the page's Stop. Raises ConfigError when the port or the
    token's file cannot be used.
    """
    broadcast = Broadcast()
    page = RigPage(total, broadcast, stopped)
    files, token = page_files(PAGE, "rig"), page_token(config)
    with serve_page(files, port, token, broadcast, page.run, report, CTRL_C):
        yield page
