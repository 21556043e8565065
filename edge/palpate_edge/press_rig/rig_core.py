"""The rig's state machine: time, bytes of printer and scale, and pictures in; bytes, files and lines out."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate_edge.common.arrays import Array
from palpate_edge.common.errors import PalpateError, RigError
from palpate_edge.common.frame import Frame
from palpate_edge.press_rig.marlin import EMERGENCY_STOP, MarlinLink
from palpate_edge.press_rig.requests import (
    Command,
    Keep,
    MoveTo,
    Request,
    TakePicture,
    Tell,
    Watch,
    Weigh,
    Weight,
)
from palpate_edge.press_rig.rig_config import RigConfig
from palpate_edge.press_rig.run_sequence import Run
from palpate_edge.press_rig.scale_link import ScaleLink, ScaleReading

EMERGENCY_RATIO = 2.0  # of stop_N, at which M112 is sent


@dataclass(slots=True)
class RigOutputs:
    """Work to be done after a step: bytes for the printer, files to store, lines to print; whether a
    picture is wanted; whether the run has ended."""

    to_printer: bytes = b""
    keep: list[Keep] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    wants_picture: bool = False
    is_done: bool = False


class RigCore:
    """Answers the requests of a run.

    target_mm: (3,) of the last move, force_N: the last reading of the scale since the last tare; None before
    the first one.
    """

    def __init__(self, rig: RigConfig, run: Run) -> None:
        self._run = run
        self._stop_N = rig.presses.stop_N
        self._settling = rig.scale.settling
        self.printer = MarlinLink(rig.printer.silence_s)
        self.scale = ScaleLink(rig.scale.unit_N, rig.scale.silence_s)
        self.target_mm: Array | None = None
        self.force_N: float | None = None
        self._request: Request | None = None  # None before the first one
        self._unsent: deque[str] = deque()  # lines of the request
        self._readings: list[float] = []
        self._to_skip = 0
        self._asked_us = 0
        self._limit_N: float | None = None
        self._stop: RigError | None = None
        self._is_stopping = False
        self._failure: PalpateError | None = None

    def stop(self, reason: str) -> None:
        """Lift the ball off and end the run; the step that ends it raises RigError with the reason."""
        self._stop = self._stop or RigError(reason)

    def process(
        self, now_us: int, from_printer: bytes, from_scale: bytes, frame: Frame | None = None
    ) -> RigOutputs:
        """Do all that can be done at a time.

        Raises RigError at the end of a run that was stopped, once the ball is off the dome or the printer
        does not answer; ConfigError for a move that is not allowed.
        """
        if self._failure is not None:
            raise self._failure
        outputs = RigOutputs()
        try:
            self._process(now_us, from_printer, from_scale, frame, outputs)
        except StopIteration:
            outputs.is_done = True
        except PalpateError as error:  # raised by the next step: what this one gave is not lost
            self._failure = error
        outputs.wants_picture = isinstance(self._request, TakePicture)
        return outputs

    def _process(
        self, now_us: int, from_printer: bytes, from_scale: bytes, frame: Frame | None, outputs: RigOutputs
    ) -> None:
        if self._request is None:
            outputs.to_printer += self.printer.open(now_us)
            self._begin(now_us, next(self._run))
        outputs.to_printer += self.printer.receive(now_us, from_printer)
        self.printer.check(now_us)
        for reading in self.scale.receive(now_us, from_scale):
            self._receive_reading(reading, outputs)
        if self._stop is None:  # the way out needs no scale
            self._check_scale(now_us)
        if self._stop is not None and not self._is_stopping:
            self._is_stopping = True
            self._begin(now_us, self._run.throw(self._stop))
        for answer in self._answers(now_us, frame, outputs):
            self._begin(now_us, self._run.send(answer))

    def _check_scale(self, now_us: int) -> None:
        try:
            self.scale.check(now_us)
        except RigError as error:
            self._stop = error

    def _begin(self, now_us: int, request: Request) -> None:
        """Prepare a request that the run has made."""
        self._request = request
        self._asked_us, self._readings, self._to_skip = now_us, [], self._settling
        self._unsent.clear()
        if isinstance(request, Command):
            self._unsent.append(request.line)
        elif isinstance(request, MoveTo):
            self.target_mm = request.to_mm
            x, y, z = request.to_mm.tolist()
            speed = 60 * request.speed_mm_s
            self._unsent += [f"G1 X{x:.3f} Y{y:.3f} Z{z:.3f} F{speed:.0f}", "M400"]

    def _answers(self, now_us: int, frame: Frame | None, outputs: RigOutputs) -> Iterator[Any]:
        """Yield the answer to the request, and to each that follows at once."""
        while True:
            request = self._request
            if isinstance(request, Command | MoveTo):
                if not self.printer.is_ready:
                    return
                if self._unsent:
                    outputs.to_printer += self.printer.send(now_us, self._unsent.popleft())
                    return
                yield self.printer.take_replies()
            elif isinstance(request, Weigh):
                if len(self._readings) < request.count:
                    return
                mean_N = float(np.mean(self._readings))
                spread_N = float(np.std(self._readings, ddof=1)) if request.count > 1 else 0.0
                yield Weight(mean_N, spread_N / math.sqrt(request.count))
            elif isinstance(request, TakePicture):
                if frame is None or frame.exposed_at_us <= self._asked_us:
                    return
                yield frame
            else:
                if isinstance(request, Keep):
                    outputs.keep.append(request)
                elif isinstance(request, Tell):
                    outputs.lines.append(request.line)
                elif isinstance(request, Watch):
                    self._limit_N = request.limit_N
                yield None

    def _receive_reading(self, reading: ScaleReading, outputs: RigOutputs) -> None:
        """Take a reading. Raises RigError, with an emergency stop among the outputs, far above the limit."""
        if self._limit_N is not None:
            self.force_N = reading.force_N - self._limit_N + self._stop_N
            if reading.force_N > self._limit_N:
                self._stop_at_force(self.force_N, outputs)
        if isinstance(self._request, Weigh):
            if self._to_skip:
                self._to_skip -= 1
            elif len(self._readings) < self._request.count:
                self._readings.append(reading.force_N)

    def _stop_at_force(self, force_N: float, outputs: RigOutputs) -> None:
        """Stop the run. Raises RigError, with an emergency stop among the outputs, far above the limit."""
        if force_N > EMERGENCY_RATIO * self._stop_N:
            self._run.close()
            outputs.to_printer = EMERGENCY_STOP
            raise RigError(
                f"the scale read {force_N:.1f} N: emergency stop (M112); reset the printer, home it and "
                "repeat the command to go on"
            )
        self.stop(
            f"the scale read {force_N:.1f} N, presses.stop_N is {self._stop_N:g}: the ball was lifted "
            "off; find what it met, then repeat the command to go on"
        )
