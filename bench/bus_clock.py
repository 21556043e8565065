"""Measure the clock synchronisation of three fingertips: `python -m bench.bus_clock`.

Three real daemons run on the hub, each with a simulated clock offset and drift. SYNC and 1013h come from the
host's `TimeStampProducer`. The hub delays each frame by up to 1 ms at random, which also changes their order,
and each daemon's time stamps of received frames are up to 1 ms late at random, as on a loaded board without
kernel time stamps. The truth is this machine's clock.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from random import Random

import click
import msgspec
import numpy as np

from palpate_bus.hub.connection import ask
from palpate_bus.hub.control import Inject
from palpate_bus.hub.faults import FaultKind, FaultRule
from palpate_edge.calibration.calibrate import calibrate
from palpate_edge.calibration.calibration_file import save_calibration
from palpate_edge.can_bus.bus import Bus, BusConfig, open_bus
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.can_bus.clock_sync import WRAP_US
from palpate_edge.common.local_clock import LocalClock
from palpate_edge.daemon.config import CaptureConfig, EstimatorConfig, FingertipConfig, NodeConfig
from palpate_edge.daemon.daemon import run
from palpate_edge.daemon.health import HealthReport
from palpate_edge.datasets.press_dataset import read_dataset
from palpate_host.network.nmt_master import SYNC, TimeStampProducer

RECORDING = Path(__file__).parent.parent / "demo" / "recording"
TICK_S = 0.01
SETTLE_S = 10.0  # half of it is needed to start the processes
HUB = "from palpate_bus.cli.main import bus; bus()"
DELAY_US = 1000


@dataclass(frozen=True, slots=True)
class Oscillator:
    """Clock offset and drift of a board."""

    offset_us: int
    drift: float


OSCILLATORS = (Oscillator(0, 0.0), Oscillator(3_600_000_000, 40e-6), Oscillator(-123_456_789, -60e-6))


class SkewedClock(LocalClock):
    """A LocalClock with offset and drift, and with random delays of received frames' time stamps."""

    def __init__(self, oscillator: Oscillator) -> None:
        super().__init__()
        self._oscillator = oscillator
        self._begin_us = time.monotonic_ns() // 1000
        self._random = Random(oscillator.offset_us)

    def at_monotonic_us(self, stamp_us: int) -> int:
        skew_us = self._oscillator.offset_us + self._oscillator.drift * (stamp_us - self._begin_us)
        return super().at_monotonic_us(stamp_us) + round(skew_us)

    def at_unix_us(self, stamp_us: int) -> int:
        return super().at_unix_us(stamp_us) + self._random.randint(0, DELAY_US)

    def truth(self) -> Truth:
        return Truth(super().at_monotonic_us(0), self._begin_us, self._oscillator)


class Truth(msgspec.Struct):
    """Parameters to convert a reading of a skewed clock to CLOCK_MONOTONIC."""

    unix_offset_us: int
    begin_us: int
    oscillator: Oscillator

    def monotonic_us(self, local_us: int) -> float:
        """Return CLOCK_MONOTONIC of a local time: the inverse of `at_monotonic_us`."""
        drift = self.oscillator.drift
        unskewed_us = local_us - self.unix_offset_us - self.oscillator.offset_us - self.begin_us
        return self.begin_us + unskewed_us / (1 + drift)


def unix_offset_us() -> float:
    """Return Unix time minus CLOCK_MONOTONIC, from the pair of readings with the shortest interval."""
    readings = []
    for _ in range(1000):
        before_ns, unix_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after_ns - before_ns, unix_ns - (before_ns + after_ns) / 2))
    return min(readings)[1] / 1000


def daemon(folder: Path, number: int, bus: BusConfig) -> None:
    """Run one fingertip of the demo; its true clock parameters are written to a file."""
    clock = SkewedClock(OSCILLATORS[number])
    name = f"finger-{number + 1}"
    config = FingertipConfig(
        name=name,
        capture=CaptureConfig("recorded", str(RECORDING / name), True),
        estimator=EstimatorConfig(str(folder / "finger.cal")),
        node=NodeConfig(0x10 + number),
        bus=bus,
        health=str(folder / f"{name}.health"),
    )
    (folder / f"{name}.truth").write_bytes(msgspec.json.encode(clock.truth()))
    run(config, clock=clock)


@contextmanager
def running(folder: Path, bus: BusConfig) -> Iterator[None]:
    """Run hub and daemons."""
    hub = subprocess.Popen(
        [sys.executable, "-c", HUB, "hub", "--socket", bus.channel], stderr=subprocess.PIPE, text=True
    )
    assert hub.stderr is not None
    hub.stderr.readline()
    context = multiprocessing.get_context("spawn")
    boards = [context.Process(target=daemon, args=(folder, number, bus)) for number in range(3)]
    try:
        for board in boards:
            board.start()
        yield
    finally:
        for board in boards:
            if board.pid is not None and board.is_alive():
                os.kill(board.pid, signal.SIGTERM)
            board.join()
        hub.terminate()
        hub.communicate()


def master(bus: Bus, seconds: float, folder: Path) -> dict[tuple[str, int], float]:
    """Send SYNC every 10 ms and return the daemons' clock errors in us by name and local time."""
    producer = TimeStampProducer()
    errors: dict[tuple[str, int], float] = {}
    begin_s = time.monotonic()
    for tick in range(round(seconds / TICK_S)):
        while (left_s := begin_s + tick * TICK_S - time.monotonic()) > 0:
            for stamp_us, frame in bus.receive(left_s):
                if frame == SYNC:
                    producer.sync_left(stamp_us)
        bus.send([*producer.due(time.time_ns() // 1000), SYNC])
        if tick % 100 == 50:
            bus.send([CanFrame(0x000, b"\x01\x00")])
            if tick * TICK_S > SETTLE_S:
                errors |= clock_errors(folder)
    return errors


def clock_errors(folder: Path) -> dict[tuple[str, int], float]:
    """Return the error of the bus time in each daemon's health file."""
    found = {}
    offset_us = unix_offset_us()
    for path in folder.glob("*.health"):
        clock = msgspec.json.decode(path.read_bytes(), type=HealthReport).clock
        truth = msgspec.json.decode(path.with_suffix(".truth").read_bytes(), type=Truth)
        error_us = clock.bus_us - truth.monotonic_us(clock.local_us) - offset_us
        found[path.stem, clock.local_us] = (error_us + WRAP_US / 2) % WRAP_US - WRAP_US / 2
    return found


@click.command()
@click.option("--seconds", default=60.0, show_default=True, help="Duration of the measurement.")
def main(seconds: float) -> None:
    """Print the clock errors in us of each daemon against the host, and between any two daemons."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        save_calibration(calibrate(read_dataset(RECORDING / "press")), folder / "finger.cal")
        config = BusConfig(interface="palpate", channel=str(folder / "hub.sock"))
        with running(folder, config):
            rule = FaultRule(kind=FaultKind.DELAY, port="master", delay_us=0, delay_max_us=DELAY_US)
            ask(Path(config.channel), Inject(rule))
            with open_bus(config, "master", [SYNC.can_id], echo=True) as bus:
                errors = master(bus, SETTLE_S + seconds, folder)
    _print(errors)


def _print(errors: dict[tuple[str, int], float]) -> None:
    by_name: dict[str, list[float]] = {}
    for (name, _), error_us in sorted(errors.items()):
        by_name.setdefault(name, []).append(error_us)
    print("clock error, us            n  median     p99     max")
    for name, values in by_name.items():
        _line(name, np.abs(values))
    rows = list(by_name.values())
    count = min(map(len, rows))
    aligned = np.array([row[:count] for row in rows])  # the same seconds, within one
    _line("between two daemons", np.ptp(aligned, axis=0))


def _line(name: str, values: np.ndarray) -> None:
    p50, p99 = np.percentile(values, [50, 99])
    print(f"{name:<22}{len(values):>6}{p50:>8.0f}{p99:>8.0f}{values.max():>8.0f}")


if __name__ == "__main__":
    main()
