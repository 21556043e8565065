"""A second of the live hand of 10 fingertips and 3 x 5 axes, played in real time on a CAN FD interface.

`canplayer` of can-utils sends what host and fingertips sent on the hub, at their times. The drive nodes are
live: they answer each SYNC. `candump` receives everything, with the kernel's time stamps.
"""

from __future__ import annotations

import statistics
import subprocess
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.bus.load.bits_on_paper import classic_bits, fd_bits

from kernel_guest.answering_drives import AnsweringDrives
from kernel_guest.large_hand import (
    DATA,
    DRIVE_NODES,
    NOMINAL,
    TICK_HZ,
    TICK_US,
    OnBus,
    answer_times_us,
    budget_percent,
)
from kernel_guest.large_hand_on_hub import LargeHandOnHub
from kernel_guest.links import PATIENCE_S
from palpate_bus.logs.candump import LogRecord, format_record, parse_record
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_host.common.mode import Mode
from palpate_host.network.nmt_master import SYNC

pytestmark = pytest.mark.uml

ANSWERS = [0x180 + node for node in DRIVE_NODES]  # TPDO 1, one CAN FD frame for five axes
REAL_TIME = 0.05  # a second may take so much longer or shorter
ATTEMPTS = 30  # seconds that are played until one takes a second and has every tick answered
ANSWERED_SHARE = 0.95  # of the ticks in such a second; user-mode Linux is a process beside others


@dataclass(frozen=True)
class Second:
    """Traffic of a second. played: of host and fingertips. answers: those of the drives to each SYNC."""

    host_id: int
    played: list[OnBus]
    answers: list[list[CanFrame]]

    @property
    def frames(self) -> list[CanFrame]:
        return [one.frame for one in self.played] + [frame for frames in self.answers for frame in frames]


def second_of_the_hand(folder: Path) -> Second:
    """Return the traffic from one SYNC to another, a second later, of a hand that turns an object."""
    rig = LargeHandOnHub(folder)
    rig.run(1.2)
    rig.frames.clear()
    rig.run(1.1)
    assert rig.hand.status.mode is Mode.MANIPULATE
    syncs = [place for place, one in enumerate(rig.frames) if one.frame == SYNC]
    frames = rig.frames[syncs[0] : syncs[TICK_HZ]]
    answers: list[list[CanFrame]] = []
    for one in frames:
        if one.frame == SYNC:
            answers.append([])
        if one.frame.can_id in ANSWERS:
            answers[-1].append(one.frame)
    played = [one for one in frames if one.frame.can_id not in ANSWERS]
    return Second(rig.hand.host_id, played, answers)


@contextmanager
def received(interface: str, folder: Path, count: int) -> Iterator[Callable[[], list[LogRecord]]]:
    """Receive `count` frames with candump; the value returns them when all are there."""
    path = folder / "received.log"
    with path.open("wb") as log:
        candump = subprocess.Popen(
            ["candump", "-L", "-r", "8000000", "-n", str(count), interface], stdout=log
        )

    def records() -> list[LogRecord]:
        candump.wait(PATIENCE_S)
        return [parse_record(line) for line in path.read_text().splitlines()]

    try:
        yield records
    finally:
        candump.kill()
        candump.wait()


def is_listening(interface: str) -> bool:
    """Return whether a socket receives every frame of an interface, as candump's does."""
    table = Path("/proc/net/can/rcvlist_all").read_text()
    return any(line.split()[:1] == [interface] for line in table.splitlines())


def bits(frames: Sequence[CanFrame]) -> float:
    """Return the bit times of the nominal rate, counted on the frames' fields as text."""
    total = 0.0
    for frame in frames:
        if frame.fd:
            nominal, data = fd_bits(frame.can_id, frame.data)
            total += nominal + data * NOMINAL / DATA
        else:
            total += classic_bits(frame)
    return total


@dataclass(frozen=True)
class Played:
    """A second as it was played. answers_us: from each SYNC to its last answer."""

    took_us: int
    answers_us: list[int]

    @property
    def in_time_us(self) -> list[int]:
        return [us for us in self.answers_us if us < TICK_US]


def play(second: Second, log: Path, interface: str, wait_until) -> Played:
    """Play the log and let the drives answer; every frame must arrive, and none else."""
    expected = Counter(second.frames)
    with (
        received(interface, log.parent, expected.total()) as records,
        AnsweringDrives(interface, second.answers),
    ):
        wait_until(lambda: is_listening(interface))
        subprocess.run(["canplayer", "-g", "0", "-I", log, f"{interface}={interface}"], check=True)
        arrived = records()
    assert Counter(record.frame for record in arrived) == expected
    host = second.host_id
    on_bus = [OnBus(one.stamp_us, host if one.frame == SYNC else 0, one.frame) for one in arrived]
    syncs = [one.at_us for one in on_bus if one.frame == SYNC]
    return Played(syncs[-1] - syncs[0] + TICK_US, answer_times_us(on_bus, host))


def written(second: Second, folder: Path, interface: str) -> Path:
    """Write a log of what `canplayer` sends to the interface; return its path."""
    log = folder / "played.log"
    log.write_text(
        "".join(format_record(LogRecord(one.at_us, one.frame, interface)) + "\n" for one in second.played)
    )
    return log


@pytest.mark.slow
def test_every_frame_of_a_second_of_the_hand_arrives(fd_vcan, tmp_path, wait_until):
    second = second_of_the_hand(tmp_path)
    played = play(second, written(second, tmp_path, fd_vcan.name), fd_vcan.name, wait_until)
    assert len(played.answers_us) == TICK_HZ - 1


@pytest.mark.quiet
def test_a_second_of_the_hand_loads_the_bus_as_the_budget_says_and_its_ticks_are_answered(
    fd_vcan, tmp_path, wait_until
):
    """pytest -rP prints the figures. A computer with other work plays some seconds too slowly."""
    second = second_of_the_hand(tmp_path)
    log = written(second, tmp_path, fd_vcan.name)
    sent_bits, in_real_time = bits(second.frames), []
    for _ in range(ATTEMPTS):
        played = play(second, log, fd_vcan.name, wait_until)
        if played.took_us != pytest.approx(1_000_000, rel=REAL_TIME):
            print(f"a second took {played.took_us / 1e6:.3f} s")
            continue
        in_real_time.append(played)
        percent = 100 * sent_bits / NOMINAL / (played.took_us * 1e-6)
        print(f"{len(second.frames)} frames in {played.took_us / 1e6:.3f} s, {percent:.2f} % of the bus")
        print(
            f"  {len(played.in_time_us)} of {len(played.answers_us)} ticks answered in time, after "
            f"{statistics.median(played.in_time_us):.0f} us, at most {max(played.in_time_us)} us"
        )
        assert percent == pytest.approx(budget_percent(), rel=0.05)
        assert percent <= 40.0
        if len(played.in_time_us) == len(played.answers_us):
            break
    if not in_real_time:
        pytest.skip(f"this computer is too busy: none of {ATTEMPTS} seconds took a second")
    print(f"by the budget {budget_percent():.2f} %")
    best = max(in_real_time, key=lambda one: len(one.in_time_us))
    assert len(best.in_time_us) >= ANSWERED_SHARE * len(best.answers_us)
