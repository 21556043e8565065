"""The fingertip's process: capture frames, estimate contacts, publish them on the bus, until it is stopped.

Two threads: the capture thread (capture_thread.py) and this one, which waits for the bus, for contacts and
for deadlines. fingertip_core.py decides; this module holds the clock, descriptors, signals and systemd.
"""

from __future__ import annotations

import hashlib
import logging
import selectors
import signal
import threading
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path

import cv2

from palpate_edge.can_bus.bus import open_bus
from palpate_edge.can_bus.reconnecting_bus import BusState, BusStateChange, ReconnectingBus
from palpate_edge.can_bus.simulated_clock import clock_of
from palpate_edge.common.contact_quantities import AI_AUTOZERO
from palpate_edge.common.errors import CaptureError, ConfigError, PalpateError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.common.local_sockets.sd_notify import Notifier, WatchdogGate
from palpate_edge.common.logs import LineLimit, LogLine, RepeatedProblem
from palpate_edge.common.signals import IDENTIFY, RECORD, RECORD_NO_MORE, called_by_signals, stop_event
from palpate_edge.daemon.capture_factory import AnyCalibration, open_source, requested_stream
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.config import FingertipConfig
from palpate_edge.daemon.estimator_factory import configured_calibration, make_estimator
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.daemon.hardware_serial import hardware_serial
from palpate_edge.daemon.health_report import FingertipParts, board_health
from palpate_edge.daemon.health_reporter import HealthReporter
from palpate_edge.daemon.loaded_configuration import configuration_digest
from palpate_edge.daemon.parameter_file import ParameterFile
from palpate_edge.daemon.parameter_store import ParameterStore
from palpate_edge.daemon.recording_control import RecordingControl
from palpate_edge.daemon.watching.view_tap import ViewTap
from palpate_edge.daemon.watching.watch_messages import (
    WatchedHealth,
    WatchRefusedError,
    WatchRequest,
    watch_paths,
)
from palpate_edge.daemon.watching.watch_socket import WatchSocket
from palpate_edge.daemon.watching.watched_fingertip import (
    TARE_TEXT,
    count_tare,
    describe,
    needed_light,
    refuse_blinking,
)
from palpate_edge.estimation.calibration import Calibration
from palpate_edge.estimation.frame_estimator import Method
from palpate_edge.estimation.uncalibrated import NO_CALIBRATION
from palpate_edge.illumination.controller_thread import open_light
from palpate_edge.node.events import (
    AcceptIdsChanged,
    Event,
    ObjectWritten,
    StoreRequested,
)
from palpate_edge.node.fingertip import TARE_IN_CONTACT_SIGNATURE, FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.stored_parameters import NOTHING_STORED

LONGEST_WAIT_S = 0.5
METHOD_CODES = {
    Method.PAPER: MethodCode.PAPER,
    Method.CORRECTED: MethodCode.CORRECTED,
    Method.POSE: MethodCode.POSE,
}

_fingertip_log = logging.getLogger("palpate.fingertip")
_console_log = logging.getLogger("palpate.console")
_camera_log = logging.getLogger("palpate.camera")
_bus_log = logging.getLogger("palpate.bus")
_parameters_log = logging.getLogger("palpate.parameters")


def run(config: FingertipConfig, clock: LocalClock | None = None) -> None:
    """Run one fingertip until SIGTERM, SIGINT or the end of a recording; log to ``palpate.*``.

    A camera or a bus that is lost meanwhile is reopened; another node with this node's id interrupts the
    contacts. Raises ConfigError, CalibrationError, DatasetError, CaptureError or BusError for what cannot be
    used at the start.
    """
    cv2.setNumThreads(1)
    clock = clock or clock_of(config.bus)
    with ExitStack() as stack:
        notifier = stack.enter_context(closing(Notifier()))
        daemon = _Daemon(config, clock, notifier, stack)
        stopped = stack.enter_context(stop_event())
        stack.enter_context(called_by_signals(daemon.signal_handlers()))
        stack.enter_context(long_lived())
        started = f"node 0x{config.node.id:02X} on {config.bus.interface}"
        _fingertip_log.info(started)
        notifier.ready(started)
        try:
            daemon.serve(stopped)
        finally:
            notifier.stopping()
    _fingertip_log.info(daemon.summary())


class _Daemon:
    """The parts that `run` holds open; `stack` closes them in reverse order."""

    def __init__(
        self, config: FingertipConfig, clock: LocalClock, notifier: Notifier, stack: ExitStack
    ) -> None:
        self._clock, self._notifier = clock, notifier
        loaded = configuration_digest(config)
        calibration = configured_calibration(config)
        estimator = make_estimator(config, calibration)
        if calibration is None:
            _fingertip_log.warning(NO_CALIBRATION)
        source = open_source(config, calibration, clock, _camera_log.warning)
        self._recording = stack.enter_context(closing(RecordingControl(config.record)))
        file = ParameterFile(Path(config.node.parameters)) if config.node.parameters else None
        serial_number = config.node.serial_number
        watch_path = watch_paths(config.name, config.health)[0]
        self._tap = ViewTap(watch_path.with_suffix(".pictures"), clock, lambda: estimator.beads)
        stack.callback(self._tap.close)
        self._capture = stack.enter_context(
            closing(CaptureThread(source, estimator, self._recording.offer, self._tap.offer))
        )
        self._node = FingertipNode(
            config.node.id,
            MethodCode.PAPER if estimator.method is None else METHOD_CODES[estimator.method],
            "" if calibration is None else calibration.checksum,
            model_hash=_model_hash(calibration),
            serial_number=hardware_serial(config.name) if serial_number is None else serial_number,
            kept=file.load() if file else NOTHING_STORED,
            stores=file is not None,
            has_led=config.illumination.i2c_bus is not None,
            outputs=estimator.outputs,
            data_bitrate=config.bus.data_bitrate,
        )
        if self._node.slave.stored_fault is not None:
            _parameters_log.error(f"{self._node.slave.stored_fault}; the defaults of the EDS apply")
        self._parameters = None if file is None else stack.enter_context(closing(ParameterStore(file)))
        light = config.illumination
        self._light = open_light(light.i2c_bus, light.address, self._node.led_set_point)
        if self._light is not None:
            stack.callback(self._light.close)
        accept_ids = self._node.slave.accept_ids
        self._bus = ReconnectingBus(lambda: open_bus(config.bus, config.name, accept_ids()))
        stack.callback(self._bus.close)
        timeout_us, is_calibrated = 1000 * config.capture.timeout_ms, calibration is not None
        self._core = FingertipCore(self._node, timeout_us, clock.now_us(), is_calibrated=is_calibrated)
        self._gate = WatchdogGate(notifier.watchdog_us)
        self._parts = FingertipParts(
            config=config,
            core=self._core,
            bus=self._bus,
            capture=self._capture,
            recording=self._recording,
            light=self._light,
            wanted_fps=requested_stream(config, calibration)[2],
            loaded=loaded,
        )
        self._reporter = stack.enter_context(closing(HealthReporter(self._parts, notifier)))
        self._camera_problem = ""
        self._conflicts = RepeatedProblem("foreign frames", "no other node uses this node id any more")
        self._bus_lines = LineLimit("changes of the bus")
        self._is_stuck = False
        self._watch: WatchSocket | None = None
        self._watched = describe(config.name, calibration, estimator, self._light, self._tap.path)
        try:
            self._watch = stack.enter_context(
                closing(WatchSocket(watch_path, self._watched, self._execute_watcher))
            )
        except ConfigError as error:
            _console_log.warning("no console: %s", error)

    def signal_handlers(self) -> dict[signal.Signals, Callable[[], None]]:
        """Return the handlers of the signals that `palpate-edge record` and `identify` send."""
        return {
            RECORD: lambda: self._recording.request(True),
            RECORD_NO_MORE: lambda: self._recording.request(False),
            IDENTIFY: self._light.blink if self._light is not None else lambda: None,
        }

    def serve(self, stopped: threading.Event) -> None:
        """Run the bus loop until `stopped` is set or the recording has ended; then withdraw the contact."""
        self._capture.start()
        if self._light is not None:
            self._light.start()
        with selectors.DefaultSelector() as selector:
            selector.register(self._capture.fileno(), selectors.EVENT_READ)
            if self._parameters is not None:
                selector.register(self._parameters.fileno(), selectors.EVENT_READ)
            if self._watch is not None:
                selector.register(self._watch.fileno(), selectors.EVENT_READ)
            registered: Descriptor | None = None
            due_us = self._clock.now_us()
            while not stopped.is_set() and not self._capture.finished:
                registered = _register(selector, registered, self._bus.descriptor())
                wait_s = (due_us - self._clock.now_us()) / 1e6
                selector.select(min(LONGEST_WAIT_S, max(0.0, wait_s)))
                due_us = self._run_once()
        now_us = self._clock.now_us()
        self._core.stop(now_us)
        self._bus.send(now_us, self._core.poll(now_us).frames_out)

    def summary(self) -> str:
        """Return the counters of this run as one line for the log."""
        health = self._capture.estimator.health
        return (
            f"{health.frames} frames, {self._capture.source.dropped} dropped, "
            f"{health.refused} refused, {health.beads_lost} beads lost, "
            f"{health.searches} whole-image searches, {health.drift_px:.2f} px drift"
        )

    def _run_once(self) -> int:
        """Serve capture, bus and deadlines once; return the local time in us of the next deadline."""
        core, bus, clock = self._core, self._bus, self._clock
        self._publish_contacts()
        self._serve_watchers()
        bus.poll(clock.now_us())
        frames = bus.receive(clock.now_us())
        core.receive(clock.now_us(), [(clock.at_unix_us(stamp_us), frame) for stamp_us, frame in frames])
        changes = bus.changes()
        for line in self._bus_lines.update(clock.now_us(), [_bus_line(change) for change in changes]):
            _bus_log.log(line.level, line.text)
        for change in changes:
            core.bus_state_changed(change)
        core.error_passive(bus.error_passive)
        core.receive_overruns(clock.now_us(), bus.receive_overruns)
        self._update_light()
        self._take_saves()
        now_us = clock.now_us()
        step = core.poll(now_us)
        bus.send(now_us, step.frames_out)
        self._log_bus(now_us)
        self._handle_events(step.events)
        if self._gate.may_feed(now_us, core.monitor.frames, bus.activity):
            self._notifier.feed_watchdog()
        self._recording.update()
        if self._reporter.update(now_us) and self._watch is not None and self._reporter.latest is not None:
            self._watch.send(WatchedHealth(self._reporter.latest))
        due = [step.next_due_us, self._reporter.due_us, bus.due_us, self._gate.due_us]
        return min(one for one in due if one is not None)

    def _publish_contacts(self) -> None:
        """Send new contacts before all else; withdraw the contact when an error ends the daemon."""
        now_us = self._clock.now_us()
        try:
            outcomes = self._capture.take()
        except (PalpateError, RuntimeError) as error:
            failure = error if isinstance(error, CaptureError) else CaptureError(str(error))
            self._core.capture_failed(now_us, failure)
            self._bus.send(now_us, self._core.poll(now_us).frames_out)
            raise
        for outcome in outcomes:
            if isinstance(outcome, CaptureError):
                self._log_camera(str(outcome))
                self._core.capture_failed(now_us, outcome)
            else:
                self._bus.send(now_us, self._core.contact(now_us, outcome))
                self._core.frame_seen(now_us, outcome, board_health(self._parts))
                self._log_camera("")

    def _serve_watchers(self) -> None:
        """Answer the console's requests and send it the newest picture that it wants."""
        if self._watch is None:
            return
        self._watch.serve()
        self._tap.is_watched = self._watch.is_watched
        frame = self._tap.take()
        if frame is not None:
            self._watch.send(frame)

    def _execute_watcher(self, request: WatchRequest) -> str:
        """Carry out a console's request as a signal or a bus master would. Raises WatchRefusedError."""
        self._reporter.due_us = 0  # the next report shows the effect
        match request.command:
            case "record":
                self._recording.request(True)
                return f"recording under {self._parts.config.record.folder}"
            case "record_no_more":
                self._recording.request(False)
                return "recording ends"
            case "tare":
                count_tare(self._watched, self._node.slave.rates, self._clock.now_us())
                self._capture.estimator.tare(accepts_contact=False)
                return TARE_TEXT
            case "light":
                needed_light(self._light)
                self._node.set_led(request.level)
                return f"LED level {request.level}"
            case "identify":
                light = needed_light(self._light)
                refuse_blinking(self._core.state)
                light.blink()
                return "the LED ring blinks for 10 s"
        raise WatchRefusedError(f"unknown command {request.command}")

    def _update_light(self) -> None:
        """Pass the level of 2030h to the controller, and the controller's problems to the node."""
        if self._light is not None:
            self._light.level = self._node.led_set_point
            latest = self._light.latest
            self._core.light(lost=latest.state is None, too_hot=latest.too_hot)

    def _handle_events(self, events: tuple[Event, ...]) -> None:
        """Carry out the node's requests: store, tare, receive filter."""
        for event in events:
            if isinstance(event, ObjectWritten) and event.index == AI_AUTOZERO:
                self._capture.estimator.tare(accepts_contact=event.value == TARE_IN_CONTACT_SIGNATURE)
            elif isinstance(event, AcceptIdsChanged):
                self._bus.accept(event.can_ids)
            elif isinstance(event, StoreRequested) and self._parameters is not None:
                self._parameters.request(event.parameters)
            elif isinstance(event, StoreRequested):
                self._node.slave.store_finished(stored=False)
                _parameters_log.warning("a master wants to store parameters: set node.parameters")

    def _take_saves(self) -> None:
        """Report finished saves to the node, which responds to the master."""
        for result in self._parameters.take() if self._parameters is not None else ():
            self._node.slave.store_finished(result.stored, result.parameters)
            if result.failure:
                _parameters_log.error(result.failure)

    def _log_bus(self, now_us: int) -> None:
        """Log when another node uses this node's id, when the bus accepts no frame, and when that is over."""
        core, is_stuck = self._core, self._bus.is_stuck(now_us)
        line = self._conflicts.update(now_us, core.conflict_problem, core.conflict.frames)
        if line is not None:
            _bus_log.log(line.level, line.text)
        if is_stuck != self._is_stuck:
            self._is_stuck = is_stuck
            if is_stuck:
                _bus_log.error(
                    "frames wait and the bus accepts none: check cabling, termination and bit rate"
                )
            else:
                _bus_log.info("the bus accepts frames again")

    def _log_camera(self, problem: str) -> None:
        """Log each camera problem once, and its end (an empty `problem`)."""
        if problem == self._camera_problem:
            return
        self._camera_problem = problem
        if problem:
            _camera_log.error(problem)
        else:
            _camera_log.info("camera gives frames again")


def _bus_line(change: BusStateChange) -> LogLine:
    level = logging.INFO if change.state is BusState.UP else logging.ERROR
    return LogLine(level, f"the bus is {change.state.value}. {change.reason}".rstrip(". "))


def _model_hash(calibration: AnyCalibration | None) -> str:
    model = calibration.model if isinstance(calibration, Calibration) else b""
    return hashlib.sha256(model).hexdigest() if model else ""


Descriptor = tuple[int, int]
"""A file descriptor and how often the bus had been opened when it was made."""


def _register(
    selector: selectors.BaseSelector, old: Descriptor | None, new: Descriptor | None
) -> Descriptor | None:
    """Wait for the bus's present descriptor, which changes when the bus is reopened; return it."""
    if new != old:
        if old is not None:
            selector.unregister(old[0])
        if new is not None:
            selector.register(new[0], selectors.EVENT_READ)
    return new
