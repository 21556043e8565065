"""The feed of the bus: its figures once a second, while a page is open. Sends nothing on the bus."""

from __future__ import annotations

import threading

from palpate_edge.can_bus.bus import Bus, open_bus
from palpate_edge.common.errors import BusError
from palpate_edge.web.broadcast import Broadcast
from palpate_host.config.hand_config import HandConfig
from palpate_host.console.bus_figures import BusFigures, BusNews, FingertipLight
from palpate_host.service.host import bus_time

PERIOD_US = 1_000_000
PAUSE_S = 0.02
"""Between two looks at the bus: frames gather meanwhile, 100 at most on a full bus."""
RETRY_S = 1.0
NO_PAGE_S = 0.2


class BusFeed:
    """Publishes the event ``bus``."""

    def __init__(self, config: HandConfig, broadcast: Broadcast) -> None:
        self._config, self._broadcast = config, broadcast
        self._now_us = bus_time(config.bus)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="bus", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the bus."""
        self._stopped.set()
        self._thread.join(2.0)

    def _run(self) -> None:
        while not self._stopped.wait(NO_PAGE_S):
            if self._broadcast.listeners:
                try:
                    with open_bus(self._config.bus, "console") as bus:
                        self._follow(bus)
                except BusError as error:
                    unknown: list[FingertipLight | None] = [None] * len(self._config.fingers)
                    self._broadcast.publish("bus", BusNews(None, None, unknown, str(error)))
                    self._stopped.wait(RETRY_S)

    def _follow(self, bus: Bus) -> None:
        """Publish figures while a page is open. Raises BusError."""
        begun_us = self._now_us()
        figures, due_us = BusFigures(self._config, begun_us), begun_us + PERIOD_US
        while self._broadcast.listeners and not self._stopped.wait(PAUSE_S):
            for stamp_us, frame in bus.receive(0.0):
                figures.take(stamp_us, frame)
            if (now_us := self._now_us()) >= due_us:
                due_us = now_us + PERIOD_US
                self._broadcast.publish("bus", figures.news(now_us))
