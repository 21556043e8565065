"""The gateway that serves AZ drives as CiA 402 nodes, so that every bus log holds their commands.

One thread a port carries out orders, round by round; the calling thread serves the bus. When the host stops
sending, the nodes' watchdogs set the torque to 0 (cia402_device); when this process dies, the drives stop
themselves (their communication timeout). The systemd watchdog is fed while every port has responses and the
bus carries frames.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from palpate_edge.can_bus.bus import Bus
from palpate_edge.common.errors import BusError
from palpate_edge.common.gc_freeze import long_lived
from palpate_edge.common.local_clock import monotonic_us
from palpate_edge.common.local_sockets.sd_notify import Notifier, WatchdogGate
from palpate_host.drives.az.axis import AzAxis, ExtraRead
from palpate_host.drives.az.common_rounds import CommonRounds
from palpate_host.drives.az.config import AzConfig, PortConfig
from palpate_host.drives.az.port import REPLY_TIMEOUT_S, AzPort
from palpate_host.drives.cia402_device import Cia402Device
from palpate_host.drives.serve_devices import serve_devices

START_LIMIT_S = 3.0
PAUSE_S = 0.001  # keeps the loop of a port without responses from spinning

_log = logging.getLogger("palpate.az")


class PortThread:
    """The thread of one port: one exchange with each axis a round."""

    def __init__(self, config: PortConfig) -> None:
        """Open the port. Raises BusError when it cannot be opened."""
        self.axes = [AzAxis(axis.settings) for axis in config.axes]
        self.rounds = 0
        self._config = config
        self._problems = [axis.problem for axis in self.axes]
        self._port = AzPort(config.path, config.baud_rate, config.line_parity, REPLY_TIMEOUT_S)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"az {config.path}")

    @property
    def responses(self) -> int:
        """Number of responses received over this port, exception responses included."""
        return self._port.responses

    @contextmanager
    def running(self) -> Iterator[None]:
        """Set the drives' watchdogs, read temperatures and positions, then run rounds until the context ends.

        Raises BusError when an axis does not respond or lacks one of these registers.
        """
        try:
            for axis in self.axes:
                self._port.watch(axis.settings.device_id, self._config.timeout_ms)
                axis.measure(monotonic_us(), self._port)
            self._thread.start()
            self._wait_for_positions()
            yield
        finally:
            self._stop.set()
            if self._thread.is_alive():
                self._thread.join()
            self._port.close()

    def _wait_for_positions(self) -> None:
        deadline = time.monotonic() + START_LIMIT_S
        while not all(axis.has_reported for axis in self.axes):
            if time.monotonic() > deadline:
                silent = next(axis for axis in self.axes if not axis.has_reported)
                raise BusError(
                    f"AZ drive {silent.settings.device_id} on {self._config.path} does not respond"
                    f" ({silent.problem}): check its address switch, the bit rate and the cable"
                )
            time.sleep(PAUSE_S)

    def _run(self) -> None:
        while not self._stop.is_set():
            place, extra = extra_read(self.rounds, len(self.axes))
            for number, axis in enumerate(self.axes):
                axis.exchange(monotonic_us(), self._port, extra if number == place else None)
                self._log_change(number, axis)
            self.rounds += 1
            time.sleep(PAUSE_S)
        for axis in self.axes:
            axis.release(self._port)

    def _log_change(self, number: int, axis: AzAxis) -> None:
        """Log each new problem of an axis, and its end."""
        if axis.problem == self._problems[number]:
            return
        self._problems[number] = axis.problem
        drive = f"drive {axis.settings.device_id} on {self._config.path}"
        if axis.problem:
            _log.error("%s: %s", drive, axis.problem)
        else:
            _log.info("%s: in order", drive)


def extra_read(round_number: int, axes: int) -> tuple[int, ExtraRead]:
    """Return the axis and the extra read of a round: status and alarm of each, then temperatures of one.

    Both take the same time on the line, so temperatures do not lengthen a round.
    """
    cycle, place = divmod(round_number, axes + 1)
    return (place, ExtraRead.HEALTH) if place < axes else (cycle % axes, ExtraRead.TEMPERATURES)


def run_gateway(bus: Bus, config: AzConfig, stop: threading.Event, notifier: Notifier) -> None:
    """Serve every axis as a node on the bus until `stop` is set. Raises BusError when a port or the bus is
    lost.

    notifier: notified once all drives respond, while they and the bus work, and before the joints are freed.
    """
    ports = [PortThread(port) for port in config.ports]
    gate, rounds = WatchdogGate(notifier.watchdog_us), CommonRounds(len(ports))

    def feed_watchdog() -> None:
        on_bus = bus.counters.sent + bus.counters.received
        if gate.may_feed(monotonic_us(), rounds.count([port.responses for port in ports]), on_bus):
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
    """Return one CiA 402 node for each axis, in the order of az.toml."""
    nodes = [axis.drive_node for port in config.ports for axis in port.axes]
    axes = [axis for port in ports for axis in port.axes]
    return [Cia402Device(node, axis) for node, axis in zip(nodes, axes, strict=True)]
