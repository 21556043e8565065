"""The LED ring kept at the level that the bus asks for, and its controller watched, in a thread of its own.

Each turn is a few transactions of a millisecond; the controller darkens by itself when they cease.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass

from palpate_edge.common.errors import IlluminationError
from palpate_edge.illumination.client import IlluminationClient, IlluminationState
from palpate_edge.illumination.registers import Fault, LightRegister

UPDATE_PERIOD_S = 0.25  # a quarter of the controller's own watchdog
FULL_LEVEL = 255
BLINK_UPDATES = 40  # 10 s, twice a second


@dataclass(frozen=True, slots=True)
class LightState:
    """state: None while the controller does not answer; problem: why, empty when it does."""

    state: IlluminationState | None
    problem: str

    @property
    def level(self) -> int:
        """What the LEDs really get, 0 (off) to 255: the inverse of the controller's gamma."""
        return 0 if self.state is None else round(FULL_LEVEL * math.sqrt(self.state.duty))

    @property
    def temperature_degC(self) -> float | None:
        """Of the silicone; None when it is not known."""
        if self.state is None or Fault.SILICONE_SENSOR in self.state.faults:
            return None
        return self.state.silicone_degC

    @property
    def too_hot(self) -> bool:
        return self.state is not None and Fault.OVER_TEMPERATURE in self.state.faults


class LightController:
    """One controller; a lost one is opened again."""

    def __init__(self, open_controller: Callable[[], IlluminationClient], level: int) -> None:
        """IlluminationError when it is not there at the start. level: 0 to 255."""
        self.level = level
        self._open = open_controller
        self._controller: IlluminationClient | None = open_controller()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light")
        self.latest = LightState(None, "not asked yet")
        self._blinks = 0
        self.update()

    def blink(self) -> None:
        """Full light and none by turns, for the next BLINK_UPDATES of them; then the level again."""
        self._blinks = BLINK_UPDATES

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """The light goes out with the controller's watchdog."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._controller is not None:
            self._controller.close()

    def update(self) -> None:
        """Ask for the state, and set the level where the controller has another: it is new, was reset, or
        darkened while we were held up."""
        try:
            if self._controller is None:
                self._controller = self._open()
            controller = self._controller
            level = self._level_now()
            if controller.read(LightRegister.LEVEL) != level:
                controller.set_level(level)
            state = controller.state()
            if Fault.BOARD_SILENT in state.faults:
                controller.clear(Fault.BOARD_SILENT)
            self.latest = LightState(state, "")
        except IlluminationError as error:
            if self._controller is not None:
                self._controller.close()
            self._controller = None
            self.latest = LightState(None, str(error))

    def _level_now(self) -> int:
        if not self._blinks:
            return self.level
        self._blinks -= 1
        return FULL_LEVEL if self._blinks % 2 else 0

    def _run(self) -> None:
        while not self._stop.wait(UPDATE_PERIOD_S):
            self.update()
