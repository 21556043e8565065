"""State of a fingertip in the terminal, kept from the events of its feed."""

from __future__ import annotations

from collections import deque

import cv2
import msgspec
import numpy as np

from palpate_edge.common.arrays import Image
from palpate_edge.common.terminal.bar_chart import Sample
from palpate_edge.console.events import ConsoleFrame, ConsoleHealth, ConsoleState
from palpate_edge.daemon.watching.watch_messages import WatchedFingertip
from palpate_edge.web.broadcast import Event

FORCE_S = 30.0
"""The force is shown over this time, as on the page."""
RATE_S = 2.0


class FingertipView:
    """The newest event of each kind, the forces of the last 30 s, and the text of the last command."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.state = ConsoleState(False, "connecting")
        self.frame: ConsoleFrame | None = None
        self.image: Image | None = None
        self.health: ConsoleHealth | None = None
        self.outer_radius_mm: float | None = None
        self.forces: deque[Sample] = deque()
        self.notice = ""
        self._arrivals: deque[float] = deque()

    def take(self, event: Event, now_s: float) -> None:
        """Keep an event; kinds that a terminal does not show are ignored."""
        kind, data = event
        match kind:
            case "state":
                self.state = _states.decode(data)
            case "fingertip":
                self.outer_radius_mm = _fingertips.decode(data).outer_radius_mm
            case "health":
                self.health = _healths.decode(data)
            case "frame":
                self._take_frame(_frames.decode(data), now_s)

    def pictures_per_s(self, now_s: float) -> float:
        """Return the rate of the pictures of the last 2 s."""
        return sum(now_s - at_s < RATE_S for at_s in self._arrivals) / RATE_S

    def picture_age_s(self, now_s: float) -> float | None:
        """Return the time since the last picture; None before the first."""
        return now_s - self._arrivals[-1] if self._arrivals else None

    def _take_frame(self, frame: ConsoleFrame, now_s: float) -> None:
        self.frame = frame
        image = cv2.imdecode(np.frombuffer(frame.jpeg, np.uint8), cv2.IMREAD_UNCHANGED)
        self.image = np.asarray(image, np.uint8)
        contact = frame.contact
        self.forces.append((now_s, contact.normal_force_N if contact.valid else None))
        self._arrivals.append(now_s)
        while self.forces[0][0] < now_s - FORCE_S:
            self.forces.popleft()
        while self._arrivals[0] < now_s - RATE_S:
            self._arrivals.popleft()


_states = msgspec.json.Decoder(ConsoleState)
_fingertips = msgspec.json.Decoder(WatchedFingertip)
_healths = msgspec.json.Decoder(ConsoleHealth)
_frames = msgspec.json.Decoder(ConsoleFrame)
