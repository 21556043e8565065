"""The closed loop on a virtual clock, for long: one process, its memory and ticks looked at each minute.

Hand, object, drives and nodes are those of `palpate-host simulate loop --direct`; the object is turned by 30
deg and back, about one axis after the other, as in the demo.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate_host.common.command import Rotate
from palpate_host.common.status import HostStatus
from palpate_host.service.host import load_hand
from palpate_host.service.host_core import HostCore, HostOutput
from palpate_twin.cli.hand import CONTACT_NOISE_MM
from palpate_twin.closed_loop.lockstep import LockstepLoop
from palpate_twin.closed_loop.tactile_rendering import TrueContactSource
from palpate_twin.demo.programme import Programme
from palpate_twin.demo.run_folder import make_run_folder
from palpate_twin.paper.trial import make_engine

LOOK_S = 0.1
YARDSTICK_TURNS = 5000


@dataclass(frozen=True, slots=True)
class Minute:
    """Virtual time since the start; the host's ticks in processor time, and an empty loop beside them, which
    tells how fast the processor was; the process's memory; how far the hand is from its target as the host
    feels it, None while it does not turn; frames on the bus."""

    end_s: float
    tick_s: np.ndarray
    yardstick_s: np.ndarray
    resident_bytes: int
    orientation_error_deg: float | None
    bus_frames: int
    mode: str


class TimedHost:
    """The host's core; keeps the processor time of every tick."""

    def __init__(self, core: HostCore) -> None:
        self._core = core
        self.tick_s: list[float] = []

    def process(self, now_us: int, frames_in: list) -> HostOutput:  # type: ignore[type-arg]
        begin_s = time.thread_time()
        output = self._core.process(now_us, frames_in)
        if output.frames_out:
            self.tick_s.append(time.thread_time() - begin_s)
        return output

    def command(self, rotate: Rotate) -> None:
        self._core.command(rotate)


def minutes(duration_s: float, every_s: float = 60.0, seed: int = 0) -> Iterator[Minute]:
    """Each minute, or `every_s`, of `duration_s`. Ends early when the host has stopped the hand."""
    with tempfile.TemporaryDirectory() as name:
        folder = make_run_folder(Path(name) / "run", None, 1_000_000)
        config, hand = load_hand(folder.hand_toml)
        contacts = TrueContactSource(1e3 * config.control.tip_radius_m, CONTACT_NOISE_MM, seed)
        loop = LockstepLoop(config, hand, make_engine(config, "mujoco", has_B=False), contacts)
        host = loop.host = TimedHost(loop.host)  # type: ignore[assignment]

        def ask(rotate: Rotate) -> HostStatus | None:
            host.command(rotate)
            return loop.status

        programme = Programme(ask, folder.commands, duration_s)
        yardstick_s: list[float] = []
        looks, every = round(duration_s / LOOK_S), round(every_s / LOOK_S)
        for look in range(1, looks + 1):
            loop.run(LOOK_S)
            programme.update(loop.status)
            yardstick_s.append(_yardstick_s())
            if look % every == 0 or look == looks or loop.is_over:
                yield _minute(loop, host, yardstick_s, look * LOOK_S)
                yardstick_s.clear()
            if loop.is_over:
                return


def _yardstick_s() -> float:
    """Processor time of an empty loop."""
    begin_s = time.thread_time()
    for _ in range(YARDSTICK_TURNS):
        pass
    return time.thread_time() - begin_s


def _minute(loop: LockstepLoop, host: TimedHost, yardstick_s: list[float], end_s: float) -> Minute:
    """What the minute was like; what the loop records of a run is let go, which an hour would pile up."""
    ticks_s, host.tick_s = np.array(host.tick_s), []
    record, status = loop.record, loop.status
    frames, record.bus_frames = record.bus_frames, 0
    record.samples.clear()
    record.contacts.clear()
    record.film[:] = [np.empty(0)] * len(record.film)
    return Minute(
        end_s,
        ticks_s,
        np.array(yardstick_s),
        resident_bytes(os.getpid()),
        None if status is None else status.orientation_error_deg,
        frames,
        "" if status is None else status.mode.value,
    )


def resident_bytes(pid: int) -> int:
    """Physical memory of a process, its shared pages with it."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
