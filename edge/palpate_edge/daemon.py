"""The fingertip's process: capture -> estimate -> node -> bus, until told to stop.

Two threads: pixels (pixel_thread.py) and this one, which waits for the bus, the pixels and the node's timers.
The bus clock of this version is Unix time in microseconds, modulo 2^32 on the wire.
"""

from __future__ import annotations

import selectors
import threading
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import cv2

from palpate_edge.bus import Bus, open_bus
from palpate_edge.calibration import Calibration, check_sensor, load_calibration
from palpate_edge.can_frame import CanFrame
from palpate_edge.capture.recorded import RealTimeSource, open_recording
from palpate_edge.config import FingertipConfig
from palpate_edge.contact_type import Contact, refused_contact
from palpate_edge.errors import BusError, CaptureError
from palpate_edge.estimator import Estimator, Method
from palpate_edge.node.events import Event, NodeIdConflict, ObjectWritten
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import AI_AUTOZERO, Health
from palpate_edge.node.fingertip_objects import Method as MethodCode
from palpate_edge.offline import check_recording
from palpate_edge.pixel_thread import PixelThread
from palpate_edge.sensor import read_sensor
from palpate_edge.stop_signals import stop_event

LONGEST_WAIT_S = 0.5
METHOD_CODES = {Method.PAPER: MethodCode.PAPER, Method.CORRECTED: MethodCode.CORRECTED}


def bus_clock() -> Callable[[], int]:
    """A clock of Unix microseconds that never steps: the monotonic clock with the offset it has now."""
    offset_ns = time.time_ns() - time.monotonic_ns()
    return lambda: (time.monotonic_ns() + offset_ns) // 1000


def run(config: FingertipConfig, report: Callable[[str], None] = lambda _line: None) -> None:
    """Run one fingertip until SIGTERM, SIGINT or the end of a recording.

    Raises ConfigError, CalibrationError, DatasetError or BusError for what cannot be used, BusError when
    the bus is lost or another node has our id, CaptureError when frames stop.
    """
    cv2.setNumThreads(1)
    calibration = load_calibration(Path(config.estimator.calibration))
    clock = bus_clock()
    source = _open_source(config, calibration, clock)
    chosen = config.estimator.method
    estimator = Estimator(calibration, None if chosen == "best" else Method(chosen))
    pixels = PixelThread(source, estimator)
    node = FingertipNode(config.node.id, METHOD_CODES[estimator.method], calibration.checksum)
    with (
        open_bus(config.bus, config.name, node.slave.accept_ids()) as bus,
        closing(pixels),
        stop_event() as stopped,
    ):
        report(f"{config.name}: node 0x{config.node.id:02X} on {config.bus.interface}")
        pixels.start()
        _serve(config, node, bus, pixels, clock, stopped)
    report(_summary(config, pixels))


def _serve(
    config: FingertipConfig,
    node: FingertipNode,
    bus: Bus,
    pixels: PixelThread,
    clock: Callable[[], int],
    stopped: threading.Event,
) -> None:
    """The bus loop."""

    def step(frames_in: list[tuple[int, CanFrame]]) -> int:
        output = node.process(clock(), [frame for _, frame in frames_in])
        bus.send(output.frames_out)
        _handle(config, output.events, pixels)
        return output.next_due_us

    with selectors.DefaultSelector() as selector:
        selector.register(bus.fileno(), selectors.EVENT_READ)
        selector.register(pixels.fileno(), selectors.EVENT_READ)
        next_due_us = step([])
        while not stopped.is_set() and not pixels.finished:
            wait_s = min(LONGEST_WAIT_S, max(0.0, (next_due_us - clock()) / 1e6))
            selector.select(wait_s)
            next_due_us = step(bus.receive(0))
            try:
                contacts = pixels.take()
            except CaptureError as error:
                _publish(node, refused_contact(0, clock(), str(error), 0, 0), pixels, clock)
                step([])
                raise
            for contact in contacts:
                _publish(node, contact, pixels, clock)
                next_due_us = step([])


def _publish(node: FingertipNode, contact: Contact, pixels: PixelThread, clock: Callable[[], int]) -> None:
    node.report_health(Health(None, pixels.source.dropped, 0, pixels.estimator.health.drift_px))
    node.publish(contact, clock() - contact.exposed_at_us)


def _handle(config: FingertipConfig, events: tuple[Event, ...], pixels: PixelThread) -> None:
    for event in events:
        if isinstance(event, NodeIdConflict):
            raise BusError(
                f"{config.name}: node id 0x{config.node.id:02X} is used twice: a frame 0x{event.can_id:03X} "
                "came from another node; give one of them another [node] id"
            )
        if isinstance(event, ObjectWritten) and event.index == AI_AUTOZERO:
            pixels.estimator.tare()


def _open_source(
    config: FingertipConfig, calibration: Calibration, clock: Callable[[], int]
) -> RealTimeSource:
    path, calibration_path = Path(config.capture.path), Path(config.estimator.calibration)
    if config.estimator.sensor:
        description = Path(config.estimator.sensor)
        check_sensor(calibration, calibration_path, read_sensor(description), description)
    recording = open_recording(path, grey=calibration.appearance.channel == "grey")
    check_recording(calibration, calibration_path, recording.sensor, path)
    return RealTimeSource(recording, loop=config.capture.loop, clock_us=clock)


def _summary(config: FingertipConfig, pixels: PixelThread) -> str:
    health = pixels.estimator.health
    return (
        f"{config.name}: {health.frames} frames, {pixels.source.dropped} dropped, {health.refused} refused, "
        f"{health.beads_lost} beads lost, {health.searches} whole-image searches, "
        f"{health.drift_px:.2f} px drift"
    )
