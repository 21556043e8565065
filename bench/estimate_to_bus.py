"""Time from a finished estimate until its TPDOs are sent, with the daemon's threads, core and bus link.

python -m bench estimate-to-bus
"""

from __future__ import annotations

import os
import selectors
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from itertools import cycle
from pathlib import Path

import numpy as np

from bench.estimator import decode
from bench.frames import Material, demo_material
from bench.timing import Row, table
from palpate_edge.can_bus.bus import BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.reconnecting_bus import ReconnectingBus
from palpate_edge.common.contact import Contact
from palpate_edge.common.frame import Frame
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.daemon.capture_thread import CaptureThread
from palpate_edge.daemon.fingertip_core import FingertipCore
from palpate_edge.estimation.estimator import Estimator
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import Health, MethodCode

FRAMES = 600
PERIOD_S = 1 / 120
SERVICE_PRIORITY = 20  # systemd/palpate-fingertip.service.d/four-cores.conf
START = CanFrame(0x000, b"\x01\x10")
HEALTH = Health(None, 0, 0)


class Camera:
    """Camera that decodes a JPEG frame every `PERIOD_S`, `FRAMES` in total."""

    dropped = damaged = 0
    exposure_us = 0

    def __init__(self, material: Material) -> None:
        self._jpegs = cycle(material.jpegs)
        self._frames = 0
        self._due_s = time.monotonic()

    def read(self) -> Frame | None:
        if self._frames == FRAMES:
            return None
        self._frames += 1
        self._due_s += PERIOD_S
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        return Frame(decode(next(self._jpegs)), _now_us(), self._frames, "")

    def close(self) -> None:
        """Do nothing: there is no resource to release."""


class TimedEstimator(Estimator):
    """Estimator that stores the time of each finished estimate."""

    given_s: list[float]

    def estimate(self, frame: Frame) -> Contact:
        contact = super().estimate(frame)
        self.given_s.append(time.perf_counter())
        return contact


def rows(material: Material, name: str, scheduling: AbstractContextManager[None]) -> list[Row]:
    """Return the times from an estimate until TPDO 1 to 3 are sent. scheduling: of the fingertip."""
    estimator = TimedEstimator(material.calibration)
    estimator.given_s = []
    with hub() as channel:
        config = BusConfig(interface="palpate", channel=channel)
        with (
            closing(ReconnectingBus(lambda: open_bus(config, "fingertip"))) as link,
            open_bus(config, "host", [0x390]) as host,
        ):
            with scheduling, long_lived():
                sent_s, busy_s = _publish(link, CaptureThread(Camera(material), estimator))
            assert host.receive(1.0)
    return [
        Row(f"estimate to TPDO 1-3 sent, {name}", np.array(sent_s) - np.array(estimator.given_s)),
        Row("  of it processor time in the bus loop", np.array(busy_s)),
    ]


def _publish(link: ReconnectingBus, pixels: CaptureThread) -> tuple[list[float], list[float]]:
    """Run the daemon's loop; return when each contact was sent, and the processor time used for it."""
    core = FingertipCore(FingertipNode(0x10, MethodCode.CORRECTED, "0" * 16), 1_000_000, _now_us())
    link.send(_now_us(), core.poll(_now_us()).frames_out)
    core.receive(_now_us(), [(_now_us(), START)])
    descriptor = link.descriptor()
    assert descriptor is not None
    sent_s: list[float] = []
    busy_s: list[float] = []
    with closing(pixels), selectors.DefaultSelector() as selector:
        selector.register(pixels.fileno(), selectors.EVENT_READ)
        selector.register(descriptor[0], selectors.EVENT_READ)
        pixels.start()
        while len(sent_s) < FRAMES:
            selector.select()
            begin_s = time.thread_time()
            for contact in pixels.take():
                assert isinstance(contact, Contact)
                now_us = _now_us()
                link.send(now_us, core.contact(now_us, contact))
                sent_s.append(time.perf_counter())
                busy_s.append(time.thread_time() - begin_s)
                core.frame_seen(now_us, contact, HEALTH)
            link.receive(_now_us())
            link.send(_now_us(), core.poll(_now_us()).frames_out)
    return sent_s, busy_s


@contextmanager
def hub() -> Iterator[str]:
    """Run a hub process and yield the path of its socket."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "hub.sock")
        start = "from palpate_bus.cli.main import bus; bus()"
        command = [sys.executable, "-c", start, "hub", "--socket", path]
        with subprocess.Popen(command, stderr=subprocess.PIPE) as hub:
            assert hub.stderr is not None
            hub.stderr.readline()  # it listens
            try:
                yield path
            finally:
                hub.terminate()
                hub.communicate()


@contextmanager
def _as_on_four_cores() -> Iterator[None]:
    """Schedule this thread and those it starts as the service does on a board with four cores.

    Raises PermissionError if real-time scheduling is not permitted.
    """
    previous = os.sched_getscheduler(0), os.sched_getparam(0)
    cores = os.sched_getaffinity(0)
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(SERVICE_PRIORITY))
    os.sched_setaffinity(0, {max(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
        os.sched_setscheduler(0, *previous)


def _now_us() -> int:
    return time.monotonic_ns() // 1000


def report() -> str:
    """Return the table; without permission for real-time scheduling, only its first half."""
    material = demo_material()
    found = rows(material, "normal scheduling", nullcontext())
    with suppress(PermissionError):
        found += rows(material, "on the service's own core", _as_on_four_cores())
    return table(f"From the estimate to the bus, {FRAMES} at 120 a second, hub at 1 Mbit/s", found)
