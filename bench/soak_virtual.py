"""Run the closed loop in simulated time in one process, and measure memory and ticks each minute.

Hand, object, drives and nodes are those of `palpate-host simulate loop --direct`. The object is turned by 30
deg and back, about one axis after the other, as in the demo.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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

POLL_PERIOD_S = 0.1
REFERENCE_LOOPS = 5000


@dataclass(frozen=True, slots=True)
class Minute:
    """Measurements of one minute.

    end_s: simulated time since the start. tick_s: processor time of the host's ticks. reference_s: processor
    time of an empty loop, which shows the processor's speed. orientation_error_deg: error estimated by the
    host, None while it does not turn the object. bus_frames: number of CAN frames.
    """

    end_s: float
    tick_s: np.ndarray
    reference_s: np.ndarray
    resident_bytes: int
    orientation_error_deg: float | None
    bus_frames: int
    mode: str


class TimedHost:
    """The host core, with the processor time of every tick."""

    def __init__(self, core: HostCore) -> None:
        self._core = core
        self.tick_s: list[float] = []

    def process(self, now_us: int, frames_in: list) -> HostOutput:  # type: ignore[type-arg]
        begin_s = time.thread_time()
        output = self._core.process(now_us, frames_in)
        if output.frames_out:
            self.tick_s.append(time.thread_time() - begin_s)
        return output

    def __getattr__(self, name: str) -> Any:
        return getattr(self._core, name)


def minutes(duration_s: float, every_s: float = 60.0, seed: int = 0) -> Iterator[Minute]:
    """Yield the measurements of each `every_s` within `duration_s`; ends early if the host stops the hand."""
    with tempfile.TemporaryDirectory() as name:
        folder = make_run_folder(Path(name) / "run", None, 1_000_000)
        config, hand = load_hand(folder.hand_toml)
        contacts = TrueContactSource(1e3 * config.control.tip_radius_m, CONTACT_NOISE_MM, seed)
        loop = LockstepLoop(config, hand, make_engine(config, "mujoco", has_B=False), contacts)
        host = loop.host = TimedHost(loop.host)  # type: ignore[assignment]

        def send_command(rotate: Rotate) -> HostStatus | None:
            host.command(rotate)
            return loop.status

        programme = Programme(send_command, folder.commands, duration_s)
        reference_s: list[float] = []
        polls, every = round(duration_s / POLL_PERIOD_S), round(every_s / POLL_PERIOD_S)
        for poll in range(1, polls + 1):
            loop.run(POLL_PERIOD_S)
            programme.update(loop.status)
            reference_s.append(_reference_s())
            if poll % every == 0 or poll == polls or loop.is_over:
                yield _minute(loop, host, reference_s, poll * POLL_PERIOD_S)
                reference_s.clear()
            if loop.is_over:
                return


def _reference_s() -> float:
    """Return the processor time of an empty loop."""
    begin_s = time.thread_time()
    for _ in range(REFERENCE_LOOPS):
        pass
    return time.thread_time() - begin_s


def _minute(loop: LockstepLoop, host: TimedHost, reference_s: list[float], end_s: float) -> Minute:
    """Return the measurements of the minute, and clear the loop's records, which would grow over an hour."""
    ticks_s, host.tick_s = np.array(host.tick_s), []
    record, status = loop.record, loop.status
    frames, record.bus_frames = record.bus_frames, 0
    record.samples.clear()
    record.contacts.clear()
    record.film[:] = [np.empty(0)] * len(record.film)
    return Minute(
        end_s,
        ticks_s,
        np.array(reference_s),
        resident_bytes(os.getpid()),
        None if status is None else status.orientation_error_deg,
        frames,
        "" if status is None else status.mode.value,
    )


def resident_bytes(pid: int) -> int:
    """Return the physical memory of a process, including shared pages."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")
