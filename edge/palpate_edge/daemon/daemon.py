"""The fingertip's process: capture -> estimate -> node -> bus, until told to stop.

Two threads: pixels (pixel_thread.py) and this one, which waits for the bus, the pixels and what is due. What
it decides is in fingertip_core.py; here are the clock, the descriptors, systemd and the health file.
"""

from __future__ import annotations

import hashlib
import selectors
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import cv2

from palpate_edge.calibration.calibration_file import load_calibration
from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.reconnecting_bus import ReconnectingBus
from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.errors import CaptureError, PalpateError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.common.sd_notify import Notifier, WatchdogGate
from palpate_edge.common.signals import IDENTIFY, RECORD, RECORD_NO_MORE, called_by_signals, stop_event
from palpate_edge.daemon.capture_factory import open_source
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.daemon.health import HealthFile, health_path
from palpate_edge.daemon.health_report import health_report
from palpate_edge.daemon.parameter_file import ParameterFile, answer_store_requests
from palpate_edge.daemon.recording_control import RecordingControl
from palpate_edge.daemon.sliding_window import DroppedFrames, SlidingWindow
from palpate_edge.estimation.estimator import Estimator, Method
from palpate_edge.illumination.client import IlluminationClient
from palpate_edge.illumination.controller_thread import LightController
from palpate_edge.node.events import (
    AcceptIdsChanged,
    BitRateActivated,
    Event,
    ObjectWritten,
    StoreRequested,
)
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import AI_AUTOZERO, Health, MethodCode
from palpate_edge.node.stored_parameters import NOTHING_STORED

LONGEST_WAIT_S = 0.5
HEALTH_EVERY_US = 1_000_000
METHOD_CODES = {Method.PAPER: MethodCode.PAPER, Method.CORRECTED: MethodCode.CORRECTED}

Report = Callable[[str], None]


def run(
    config: FingertipConfig, report: Report = lambda _line: None, clock: LocalClock | None = None
) -> None:
    """Run one fingertip until SIGTERM, SIGINT or the end of a recording.

    A camera or a bus that is lost while it runs is opened again. Raises ConfigError, CalibrationError,
    DatasetError, CaptureError or BusError for what cannot be used, BusError when another node has our id.
    """
    cv2.setNumThreads(1)
    clock = clock or clock_of(config.bus)
    with ExitStack() as stack:
        notifier = stack.enter_context(closing(Notifier()))
        daemon = _Daemon(config, report, clock, notifier, stack)
        stopped = stack.enter_context(stop_event())
        stack.enter_context(called_by_signals(daemon.calls()))
        stack.enter_context(long_lived())
        report(f"{config.name}: node 0x{config.node.id:02X} on {config.bus.interface}")
        notifier.ready(f"node 0x{config.node.id:02X} on {config.bus.interface}")
        try:
            daemon.serve(stopped)
        finally:
            notifier.stopping()
    report(daemon.summary())


class _Daemon:
    """What `run` holds open; all of it is closed by `stack`, in the reverse order."""

    def __init__(
        self, config: FingertipConfig, report: Report, clock: LocalClock, notifier: Notifier, stack: ExitStack
    ) -> None:
        self._config, self._report, self._clock, self._notifier = config, report, clock, notifier
        calibration = load_calibration(Path(config.estimator.calibration))
        chosen = config.estimator.method
        estimator = Estimator(calibration, None if chosen == "best" else Method(chosen))
        source = open_source(config, calibration, clock, report)
        self.recording = stack.enter_context(closing(RecordingControl(config.record, self._say)))
        self._pixels = stack.enter_context(closing(CaptureThread(source, estimator, self.recording.offer)))
        self._parameters = ParameterFile(Path(config.node.parameters)) if config.node.parameters else None
        self._node = FingertipNode(
            config.node.id,
            METHOD_CODES[estimator.method],
            calibration.checksum,
            model_hash=hashlib.sha256(calibration.model).hexdigest() if calibration.model else "",
            serial_number=config.node.serial_number,
            kept=self._parameters.load() if self._parameters else NOTHING_STORED,
            has_led=config.illumination.i2c_bus is not None,
        )
        self._light = _open_light(config, self._node.led_set_point)
        if self._light is not None:
            stack.callback(self._light.close)
        accept_ids = self._node.slave.accept_ids
        self._link = ReconnectingBus(lambda: open_bus(config.bus, config.name, accept_ids()))
        stack.callback(self._link.close)
        self._core = FingertipCore(self._node, config.name, 1000 * config.capture.timeout_ms, clock.now_us())
        self._gate = WatchdogGate(notifier.watchdog_us)
        self._fps = config.capture.camera.fps or calibration.sensor.camera.fps
        path = health_path(config.name, config.health)
        self._health_file = stack.enter_context(closing(HealthFile(path, self._say)))
        self._health_at_us = 0
        self._dropped_frames, self._dropped_pdos = DroppedFrames(), SlidingWindow()
        self._said_of_camera = ""

    def calls(self) -> dict[signal.Signals, Callable[[], None]]:
        """What a person may ask of it: `palpate-edge record` and `identify` send these signals."""
        return {
            RECORD: lambda: self.recording.request(True),
            RECORD_NO_MORE: lambda: self.recording.request(False),
            IDENTIFY: self._light.blink if self._light is not None else lambda: None,
        }

    def serve(self, stopped: threading.Event) -> None:
        """The bus loop."""
        self._pixels.start()
        if self._light is not None:
            self._light.start()
        with selectors.DefaultSelector() as selector:
            selector.register(self._pixels.fileno(), selectors.EVENT_READ)
            on_bus: tuple[int, int] | None = None
            due_us = self._clock.now_us()
            while not stopped.is_set() and not self._pixels.finished:
                on_bus = _follow(selector, on_bus, self._link.descriptor())
                wait_s = (due_us - self._clock.now_us()) / 1e6
                selector.select(min(LONGEST_WAIT_S, max(0.0, wait_s)))
                due_us = self._turn()
        now_us = self._clock.now_us()
        self._core.stop(now_us)
        self._link.send(now_us, self._core.poll(now_us).frames_out)

    def summary(self) -> str:
        health = self._pixels.estimator.health
        return (
            f"{self._config.name}: {health.frames} frames, {self._pixels.source.dropped} dropped, "
            f"{health.refused} refused, {health.beads_lost} beads lost, "
            f"{health.searches} whole-image searches, {health.drift_px:.2f} px drift"
        )

    def _turn(self) -> int:
        """One turn of the loop; returns when the next is due at the latest."""
        core, link, clock = self._core, self._link, self._clock
        self._take_pixels()
        link.poll(clock.now_us())
        frames = link.receive(clock.now_us())
        core.receive(clock.now_us(), [(clock.at_unix_us(stamp_us), frame) for stamp_us, frame in frames])
        for change in link.changes():
            self._say(f"the bus is {change.state.value}. {change.reason}".rstrip(". "))
            core.bus_state_changed(change)
        core.error_passive(link.error_passive)
        self._see_to_light()
        now_us = clock.now_us()
        step = core.poll(now_us)
        link.send(now_us, step.frames_out)
        self._see_to(step.events)
        if self._gate.may_feed(now_us, core.monitor.frames, link.sent + link.received):
            self._notifier.feed_watchdog()
        self.recording.update()
        if now_us >= self._health_at_us:
            self._health_at_us = now_us + HEALTH_EVERY_US
            self._tell_health(now_us)
        due = [step.next_due_us, self._health_at_us, link.due_us, self._gate.due_us]
        return min(one for one in due if one is not None)

    def _take_pixels(self) -> None:
        """Contacts go on the bus before all else; what ends the daemon withdraws the last one first."""
        now_us = self._clock.now_us()
        try:
            outcomes = self._pixels.take()
        except (PalpateError, RuntimeError) as error:
            failure = error if isinstance(error, CaptureError) else CaptureError(str(error))
            self._core.capture_failed(now_us, failure)
            self._link.send(now_us, self._core.poll(now_us).frames_out)
            raise
        for outcome in outcomes:
            if isinstance(outcome, CaptureError):
                self._tell_of_camera(str(outcome))
                self._core.capture_failed(now_us, outcome)
            else:
                self._link.send(now_us, self._core.contact(now_us, outcome))
                self._core.frame_seen(now_us, outcome, self._board_health())
                self._tell_of_camera("")

    def _board_health(self) -> Health:
        health, link = self._pixels.estimator.health, self._link
        light = self._light.latest if self._light else None
        return Health(
            temperature_degC=light.temperature_degC if light else None,
            frames_dropped=self._pixels.source.dropped,
            led_level=light.level if light else 0,
            skin_drift_px=health.drift_px,
            whole_image_searches=health.searches,
            transmit_retries=link.retries,
            bus_restarts=link.restarts,
            exposure_us=self._pixels.source.exposure_us,
        )

    def _see_to_light(self) -> None:
        """2030h goes to the controller, its trouble to the bus; what is told is in the health file."""
        if self._light is not None:
            self._light.level = self._node.led_set_point
            latest = self._light.latest
            self._core.light(lost=latest.state is None, too_hot=latest.too_hot)

    def _see_to(self, events: tuple[Event, ...]) -> None:
        """What the bus asks of the board."""
        if self._parameters is not None:
            for line in answer_store_requests(self._node.slave, events, self._parameters):
                self._say(line)
        for event in events:
            if isinstance(event, ObjectWritten) and event.index == AI_AUTOZERO:
                self._pixels.estimator.tare()
            elif isinstance(event, AcceptIdsChanged):
                self._link.accept(event.can_ids)
            elif isinstance(event, StoreRequested) and self._parameters is None:
                self._node.slave.store_finished(stored=False)
                self._say("a master wants to store parameters: set node.parameters")
            elif isinstance(event, BitRateActivated):
                self._say(
                    f"LSS asks for {event.bit_rate_kbit_s} kbit/s: the bit rate is the link's, set BitRate= "
                    "in its .network file"
                )

    def _tell_of_camera(self, trouble: str) -> None:
        """Each trouble once, and its end."""
        if trouble != self._said_of_camera:
            self._said_of_camera = trouble
            self._say(trouble or "camera gives frames again")

    def _tell_health(self, now_us: int) -> None:
        light = self._light.latest if self._light else None
        frames, dropped = self._core.monitor.frames, self._pixels.source.dropped
        dropped_share = self._dropped_frames.share(now_us, frames, dropped)
        (pdos_dropped_lately,) = self._dropped_pdos.growth(now_us, (self._link.dropped,))
        report = health_report(
            self._config,
            self._core,
            self._link,
            self._pixels,
            self._fps,
            self.recording.folder,
            light,
            dropped_share,
            pdos_dropped_lately,
            now_us,
        )
        trouble = ", ".join(report.emergencies)
        self._notifier.status(
            f"{report.nmt_state}, {report.camera.fps:.0f} frames/s, bus {report.bus.state}"
            + (f"; {trouble}" if trouble else "")
        )
        self._health_file.write(report)

    def _say(self, line: str) -> None:
        self._report(f"{self._config.name}: {line}")


def _open_light(config: FingertipConfig, level: int) -> LightController | None:
    bus, address = config.illumination.i2c_bus, config.illumination.address
    return None if bus is None else LightController(lambda: IlluminationClient.open(bus, address), level)


Descriptor = tuple[int, int]


def _follow(
    selector: selectors.BaseSelector, old: Descriptor | None, new: Descriptor | None
) -> Descriptor | None:
    """Wait for the bus's present descriptor, which changes when the bus is opened again."""
    if new != old:
        if old is not None:
            selector.unregister(old[0])
        if new is not None:
            selector.register(new[0], selectors.EVENT_READ)
    return new
