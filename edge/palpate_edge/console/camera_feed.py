"""The feed without a daemon: this process takes the camera, with or without a calibration, and no bus."""

from __future__ import annotations

import selectors
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.arrays import Image
from palpate_edge.common.contact import Contact
from palpate_edge.common.errors import CaptureError, PalpateError
from palpate_edge.common.frame import Frame
from palpate_edge.common.sliding_window import DroppedFrames
from palpate_edge.console.events import (
    ConsoleHealth,
    ConsoleState,
    calibration_row,
    light_rows,
    sensor_rows,
)
from palpate_edge.console.feed import NewestPicture
from palpate_edge.console.guide_feed import GuideFeed
from palpate_edge.console.pictures import LooseBeads, console_frame
from palpate_edge.daemon.capture_factory import open_source, requested_stream
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.check_rows import CheckRow, Verdict
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.estimator_factory import configured_calibration, make_estimator
from palpate_edge.daemon.frame_monitor import FrameMonitor
from palpate_edge.daemon.health_report import bead_health, camera_health, light_health, picture_health
from palpate_edge.daemon.recording_control import RecordingControl
from palpate_edge.daemon.watching.view_tap import PictureRate
from palpate_edge.daemon.watching.watch_messages import BeadsShown, WatchCommand, beads_shown
from palpate_edge.daemon.watching.watched_fingertip import TARE_TEXT, count_tare, describe, needed_light
from palpate_edge.estimation.frame_estimator import BeadsInView
from palpate_edge.illumination.controller_thread import FULL_LEVEL, open_light
from palpate_edge.node.change_policy import WriteRates
from palpate_edge.web.broadcast import Broadcast

HEALTH_S = 1.0
LIVE = "live, from the camera: no daemon runs, so contacts are not published"
NO_BUS = CheckRow("bus", "not used", "", Verdict.ABSENT, "")

Shown = tuple[Image, Contact, float, BeadsInView | None]


class CameraFeed:
    """Reads, estimates and publishes frames. report: takes one line for each setting that differs;
    widest_px: of the published pictures.

    Raises ConfigError, CalibrationError, DatasetError, CaptureError or IlluminationError for what cannot be
    used.
    """

    def __init__(
        self,
        config: FingertipConfig,
        report: Callable[[str], None],
        broadcast: Broadcast,
        picture: NewestPicture,
        widest_px: int,
    ) -> None:
        self._config, self._broadcast, self._picture = config, broadcast, picture
        self._widest_px = widest_px
        self._clock = clock_of(config.bus)
        self._stopped = threading.Event()
        self._rate, self._shown = PictureRate(), threading.Condition()
        self._newest: Shown | None = None
        self._guide = GuideFeed(config, broadcast)
        self._dropped_frames = DroppedFrames()
        self._health_at_s = 0.0
        self._tares = WriteRates()
        with ExitStack() as stack:
            calibration = configured_calibration(config)
            self._estimator = make_estimator(config, calibration)
            self._loose = LooseBeads() if calibration is None else None
            source = open_source(config, calibration, self._clock, report)
            self._wanted_fps = requested_stream(config, calibration)[2]
            self._recording = stack.enter_context(closing(RecordingControl(config.record)))
            self._capture = stack.enter_context(
                closing(CaptureThread(source, self._estimator, self._recording.offer, self._offer))
            )
            light = config.illumination
            self._light = open_light(light.i2c_bus, light.address, FULL_LEVEL)
            if self._light is not None:
                stack.callback(self._light.close)
                self._light.start()
            self._fingertip = describe(config.name, calibration, self._estimator, self._light, Path())
            self._monitor = FrameMonitor(1000 * config.capture.timeout_ms, self._clock.now_us())
            self._stack = stack.pop_all()
        broadcast.publish("fingertip", self._fingertip)
        broadcast.publish("state", ConsoleState(True, LIVE))
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._follow, self._encode)]
        self._capture.start()
        for thread in self._threads:
            thread.start()

    def execute(self, command: WatchCommand, level: int) -> str:
        """Carry out a command as a daemon would. Raises WatchRefusedError."""
        self._health_at_s = 0.0
        match command:
            case "record":
                self._recording.request(True)
                return f"recording under {self._config.record.folder}"
            case "record_no_more":
                self._recording.request(False)
                return "recording ends"
            case "tare":
                count_tare(self._fingertip, self._tares, self._clock.now_us())
                self._estimator.tare(accepts_contact=False)
                return TARE_TEXT
            case "light":
                needed_light(self._light).level = level
                return f"LED level {level}"
            case "identify":
                needed_light(self._light).blink()
                return "the LED ring blinks for 10 s"
        raise ValueError(command)

    def guide(self, action: str, number: float | None) -> str:
        """Start the guided calibration or answer it."""
        return self._guide.answer(action, number)

    def close(self) -> None:
        """Release the camera; end a recording."""
        self._stopped.set()
        self._guide.close()
        for thread in self._threads:
            thread.join(2.0)
        self._stack.close()

    def _offer(self, frame: Frame, contact: Contact) -> bool:
        """Keep a frame for the page and for the guide; called by the capture thread."""
        self._guide.offer(frame.image, frame.exposed_at_us, self._capture.source.exposure_us)
        if self._broadcast.listeners and self._rate.takes(frame.exposed_at_us):
            latency_ms = (self._clock.now_us() - frame.exposed_at_us) / 1000
            with self._shown:
                self._newest = frame.image, contact, latency_ms, self._estimator.beads
                self._shown.notify()
        return False

    def _encode(self) -> None:
        """Publish the newest frame, outside of the capture thread."""
        while not self._stopped.is_set():
            with self._shown:
                self._shown.wait_for(lambda: self._newest is not None, 0.2)
                newest, self._newest = self._newest, None
            if newest is None:
                continue
            image, contact, latency_ms, beads = newest
            self._picture.show(image, contact.sequence)
            shown = self._beads(image, beads)
            self._broadcast.publish(
                "frame", console_frame(image, contact, latency_ms, shown, self._widest_px)
            )

    def _beads(self, image: Image, beads: BeadsInView | None) -> BeadsShown | None:
        if self._loose is not None:
            return self._loose.find(image)
        return None if beads is None else beads_shown(beads)

    def _follow(self) -> None:
        """Take the contacts, and publish health each second, until the source ends."""
        problem = ""
        with selectors.DefaultSelector() as selector:
            selector.register(self._capture.fileno(), selectors.EVENT_READ)
            while not self._stopped.is_set():
                selector.select(0.2)
                try:
                    outcomes = self._capture.take()
                except (PalpateError, RuntimeError) as error:
                    self._broadcast.publish("state", ConsoleState(False, str(error)))
                    return
                for outcome in outcomes:
                    if isinstance(outcome, Contact):
                        self._monitor.frame_estimated(
                            self._clock.now_us(), outcome, self._capture.source.dropped
                        )
                    new = str(outcome) if isinstance(outcome, CaptureError) else ""
                    if new != problem:
                        self._broadcast.publish("state", ConsoleState(not new, new or LIVE))
                    problem = new
                self._recording.update()
                if time.monotonic() >= self._health_at_s:
                    self._health_at_s = time.monotonic() + HEALTH_S
                    self._broadcast.publish("health", self._health())
                if self._capture.finished:
                    self._broadcast.publish("state", ConsoleState(False, "the recording has ended"))
                    return

    def _health(self) -> ConsoleHealth:
        config, source, now_us = self._config, self._capture.source, self._clock.now_us()
        monitor, measure = self._monitor, self._estimator.picture
        dropped_share = self._dropped_frames.share(now_us, monitor.frames, source.dropped)
        camera = camera_health(
            config.capture, self._capture, monitor, self._wanted_fps, dropped_share, now_us
        )
        beads = bead_health(monitor, self._estimator.health)
        light = None if self._light is None else light_health(self._light.latest)
        rows = sensor_rows(
            camera,
            beads,
            None if measure is None else picture_health(measure),
            config.capture.timeout_ms,
        )
        calibration = calibration_row(config.estimator.calibration, self._fingertip.method)
        return ConsoleHealth(
            fps=camera.fps,
            dropped=camera.dropped,
            nmt_state="",
            recording=self._recording.folder,
            light=light,
            rows=[*rows, calibration, NO_BUS, *light_rows(light)],
        )
