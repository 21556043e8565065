"""The thread that keeps the LED ring at the level of 2030h and polls its controller.

An update takes about ten transactions of a millisecond. Without updates the controller turns the LEDs off by
itself.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable

import msgspec

from palpate_edge.common.errors import IlluminationError
from palpate_edge.illumination.client import IlluminationClient, IlluminationState
from palpate_edge.illumination.registers import Fault, LightRegister

UPDATE_PERIOD_S = 0.25  # a quarter of the controller's own watchdog
FULL_LEVEL = 255
BLINK_UPDATES = 40  # 10 s at two flashes a second


class LightState(msgspec.Struct, frozen=True):
    """The last answer. state: None while the controller does not answer; problem: the reason, else empty.

    losses: times that the controller stopped answering, since the start.
    """

    state: IlluminationState | None
    problem: str
    losses: int = 0

    @property
    def level(self) -> int:
        """The level that the LEDs really have, 0 (off) to 255: the inverse of the controller's gamma."""
        return 0 if self.state is None else round(FULL_LEVEL * math.sqrt(self.state.duty))

    @property
    def temperature_degC(self) -> float | None:
        """The silicone's temperature; None when it is not known."""
        if self.state is None or Fault.SILICONE_SENSOR in self.state.present:
            return None
        return self.state.silicone_degC

    @property
    def too_hot(self) -> bool:
        """True while the controller keeps the LEDs off for over-temperature."""
        return self.state is not None and Fault.OVER_TEMPERATURE in self.state.present


class LightController:
    """Keeps one controller at a level; a lost controller is opened again.

    level: 0 to 255, may be set at any time. latest: the last answer.
    """

    def __init__(self, open_controller: Callable[[], IlluminationClient], level: int) -> None:
        """Raises IlluminationError when the controller is missing at the start."""
        self.level = level
        self._open = open_controller
        self._controller: IlluminationClient | None = open_controller()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="light")
        self.latest = LightState(None, "not polled yet")
        self._blinks = 0
        self.update()

    def blink(self) -> None:
        """Alternate full light and none for the next BLINK_UPDATES updates, then return to the level."""
        self._blinks = BLINK_UPDATES

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the controller, whose watchdog then turns the LEDs off."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._controller is not None:
            self._controller.close()

    def update(self) -> None:
        """Set the level if the controller has another one (new, reset, or off after a pause), and read the
        state."""
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
            self.latest = LightState(state, "", self.latest.losses)
        except IlluminationError as error:
            if self._controller is not None:
                self._controller.close()
            self._controller = None
            lost = self.latest.state is not None
            self.latest = LightState(None, str(error), self.latest.losses + lost)

    def _level_now(self) -> int:
        if not self._blinks:
            return self.level
        self._blinks -= 1
        return FULL_LEVEL if self._blinks % 2 else 0

    def _run(self) -> None:
        while not self._stop.wait(UPDATE_PERIOD_S):
            self.update()


def open_light(i2c_bus: int | None, address: int, level: int) -> LightController | None:
    """Return the controller at an I2C address, with this level; None without a bus."""
    if i2c_bus is None:
        return None
    return LightController(lambda: IlluminationClient.open(i2c_bus, address), level)
