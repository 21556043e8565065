"""AZ drives as CiA 402 nodes: the host commands every drive the same way, and every log holds all it did.

One thread a port carries orders out round by round; the calling thread serves the bus. When the host falls
silent, the nodes' own watchdogs take the torque away (cia402_device); when this process dies, the drives do
(their communication timeout). systemd hears of it while every port has answers and the bus goes on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from palpate_edge.can_bus.bus import Bus
from palpate_edge.common.errors import BusError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.common.sd_notify import Notifier, WatchdogGate
from palpate_host.drives.az.axis import AzAxis, Question
from palpate_host.drives.az.common_rounds import CommonRounds
from palpate_host.drives.az.config import AzConfig, PortConfig
from palpate_host.drives.az.port import REPLY_TIMEOUT_S, AzPort
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.serve_devices import serve_devices

START_LIMIT_S = 3.0
PAUSE_S = 0.001  # a port on which nothing answers must not spin


class PortThread:
    """The rounds of one port."""

    def __init__(self, config: PortConfig) -> None:
        """BusError when the port cannot be opened."""
        self.axes = [AzAxis(axis.settings) for axis in config.axes]
        self.rounds = 0
        self._config = config
        self._port = AzPort(config.path, config.baud_rate, config.line_parity, REPLY_TIMEOUT_S)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"az {config.path}")

    @property
    def answers(self) -> int:
        """Replies that came over this port, refusals too."""
        return self._port.answers

    @contextmanager
    def running(self) -> Iterator[None]:
        """Watchdogs set, temperatures read, all axes heard, then rounds until the context ends.

        BusError when an axis, or one of these registers, is missing.
        """
        try:
            for axis in self.axes:
                self._port.watch(axis.settings.device_id, self._config.timeout_ms)
                axis.measure(monotonic_us(), self._port)
            self._thread.start()
            self._wait_until_heard()
            yield
        finally:
            self._stop.set()
            if self._thread.is_alive():
                self._thread.join()
            self._port.close()

    def _wait_until_heard(self) -> None:
        deadline = time.monotonic() + START_LIMIT_S
        while not all(axis.is_heard for axis in self.axes):
            if time.monotonic() > deadline:
                silent = next(axis for axis in self.axes if not axis.is_heard)
                raise BusError(
                    f"AZ drive {silent.settings.device_id} on {self._config.path} does not answer"
                    f" ({silent.problem}): check its address switch, the bit rate and the cable"
                )
            time.sleep(PAUSE_S)

    def _run(self) -> None:
        while not self._stop.is_set():
            asked, question = turn(self.rounds, len(self.axes))
            for number, axis in enumerate(self.axes):
                axis.exchange(monotonic_us(), self._port, question if number == asked else None)
            self.rounds += 1
            time.sleep(PAUSE_S)
        for axis in self.axes:
            axis.release(self._port)


def turn(round_number: int, axes: int) -> tuple[int, Question]:
    """Which axis is asked what beside its motion: status and alarm of each, then the temperatures of one.

    Both take as long on the line, so that a round is no longer than without temperatures.
    """
    cycle, place = divmod(round_number, axes + 1)
    return (place, Question.HEALTH) if place < axes else (cycle % axes, Question.TEMPERATURES)


def run_gateway(bus: Bus, config: AzConfig, stop: threading.Event, notifier: Notifier) -> None:
    """Serve every axis as a node on the bus until `stop` is set; BusError when a port or the bus is gone.

    notifier: told when all drives answer, while they and the bus go on, and before the joints are let go.
    """
    ports = [PortThread(port) for port in config.ports]
    gate, rounds = WatchdogGate(notifier.watchdog_us), CommonRounds(len(ports))

    def feed_watchdog() -> None:
        on_bus = bus.counters.sent + bus.counters.received
        if gate.may_feed(monotonic_us(), rounds.count([port.answers for port in ports]), on_bus):
            notifier.feed_watchdog()

    with ExitStack() as stack:
        for port in ports:
            stack.enter_context(port.running())
        devices = devices_of(config, ports)
        stack.enter_context(long_lived())
        notifier.ready(f"{len(devices)} drives on {len(ports)} ports and {config.bus.interface}")
        serve_devices(bus, devices, stop, feed_watchdog)
        notifier.stopping()


def devices_of(config: AzConfig, ports: Sequence[PortThread]) -> list[Cia402Device]:
    """One CiA 402 node for each axis, in the order of az.toml."""
    nodes = [axis.drive_node for port in config.ports for axis in port.axes]
    axes = [axis for port in ports for axis in port.axes]
    return [Cia402Device(node, axis) for node, axis in zip(nodes, axes, strict=True)]
