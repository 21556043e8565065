"""The time of a simulated hand: on a machine whose time is an argument, and between processes."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate_edge.can_bus.bus import BusConfig
from palpate_edge.can_bus.simulated_clock import (
    AHEAD_US,
    FORMAT,
    GONE_US,
    SLOW_FACTOR,
    ClockKeeper,
    SimulatedClock,
    clock_of,
    make_clock,
)
from palpate_edge.common.errors import ConfigError
from palpate_edge.common.local_clock import monotonic_us

LOOK_US = 2_000
KEPT = st.sampled_from(["fast", "slowly", "nothing"])


class Machine:
    """Its CLOCK_MONOTONIC, a clock with a keeper, and two who read it."""

    def __init__(self, path: Path) -> None:
        self.us = 5_000_000_000
        make_clock(path)
        self.readers = [SimulatedClock(path, lambda: self.us) for _ in range(2)]
        self.keeper = ClockKeeper(path, lambda: self.us)

    def times_us(self) -> list[int]:
        return [reader.now_us() for reader in self.readers]


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path / "clock")


def test_without_a_keeper_it_is_the_machines(tmp_path):
    make_clock(tmp_path / "clock")
    clock = SimulatedClock(tmp_path / "clock")
    before_us = monotonic_us()
    assert before_us <= clock.now_us() <= monotonic_us()


def test_a_keeper_in_time_does_not_hold_it(machine):
    for _ in range(1000):
        machine.keeper.go_on(slowly=False)
        machine.us += LOOK_US
        assert machine.times_us() == [machine.us] * 2
    assert machine.keeper.held_us == 0


def test_a_keeper_that_stops_stops_the_time_and_loses_none(machine):
    machine.keeper.go_on(slowly=False)
    start_us = machine.us
    machine.us += 1_000_000
    assert machine.times_us() == [start_us + AHEAD_US] * 2
    machine.keeper.go_on(slowly=False)
    assert machine.times_us() == [start_us + AHEAD_US] * 2
    assert machine.keeper.held_us == 1_000_000 - AHEAD_US
    machine.us += LOOK_US
    assert machine.times_us() == [start_us + AHEAD_US + LOOK_US] * 2


def test_while_the_keeper_waits_the_time_goes_slowly(machine):
    machine.keeper.go_on(slowly=False)
    before_us = machine.us
    for _ in range(500):
        machine.us += LOOK_US
        machine.keeper.go_on(slowly=True)
    # What it had been allowed before, and a tenth of the rest.
    assert machine.times_us()[0] - before_us == pytest.approx(1e6 / SLOW_FACTOR, abs=AHEAD_US)


def test_a_keeper_that_is_gone_holds_nothing_for_long(machine):
    machine.keeper.go_on(slowly=False)
    start_us = machine.us
    machine.us += GONE_US + 2_000_000
    assert machine.times_us() == [start_us + 2_000_000] * 2


def test_at_the_end_it_is_free_and_does_not_jump(machine):
    machine.keeper.go_on(slowly=False)
    machine.us += 400_000
    (before_us, _) = machine.times_us()
    machine.keeper.close()
    assert machine.times_us() == [before_us] * 2
    machine.us += 10_000_000
    assert machine.times_us() == [before_us + 10_000_000] * 2


@given(turns=st.lists(st.tuples(st.integers(0, 8_000_000), KEPT), max_size=40))
def test_all_read_the_same_and_never_less_than_before(tmp_path_factory, turns):
    machine = Machine(tmp_path_factory.mktemp("clock") / "clock")
    last_us = machine.times_us()[0]
    for passed_us, kept in turns:
        machine.us += passed_us
        if kept != "nothing":
            machine.keeper.go_on(slowly=kept == "slowly")
        one_us, other_us = machine.times_us()
        assert one_us == other_us == machine.keeper.now_us()
        assert last_us <= one_us <= min(machine.us, last_us + max(passed_us, AHEAD_US))
        last_us = one_us


def test_no_reader_sees_half_a_word(tmp_path):
    """Another process writes two values that differ in every byte, as fast as it can."""
    make_clock(tmp_path / "clock")
    flicker = (
        "import sys, time; from pathlib import Path\n"
        "from palpate_edge.can_bus.simulated_clock import ClockKeeper\n"
        "keeper = ClockKeeper(Path(sys.argv[1]))\n"
        "keeper._words[2] = 0x0101010101010101\n"
        "print('ready', flush=True)\n"
        "while True:\n"
        "    keeper._words[2] = 0x3E3E3E3E3E3E3E3E\n"
        "    keeper._words[2] = 0x0101010101010101\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", flicker, str(tmp_path / "clock")], stdout=subprocess.PIPE, text=True
    ) as writer:
        assert writer.stdout is not None and writer.stdout.readline() == "ready\n"
        words = SimulatedClock(tmp_path / "clock")._words
        seen, end_s = set(), time.monotonic() + 20.0
        while len(seen) < 2 and time.monotonic() < end_s:  # a writer that gets no processor changes nothing
            seen.add(words[2])
        for _ in range(300_000):
            seen.add(words[2])
        writer.kill()
    assert {f"{word:x}" for word in seen} == {"101010101010101", "3e3e3e3e3e3e3e3e"}


@given(content=st.binary(max_size=40))
def test_what_is_no_clock_is_refused(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("clock") / "clock"
    path.write_bytes(content)
    if len(content) == FORMAT.size and content.startswith(b"PALPTIME"):
        return
    for kind in (SimulatedClock, ClockKeeper):
        with pytest.raises(ConfigError, match="is not the clock of a simulated hand"):
            kind(path)


def test_a_clock_that_is_missing_or_on_a_real_bus_is_refused(tmp_path):
    path = str(tmp_path / "clock")
    with pytest.raises(ConfigError, match="bus hub --clock"):
        clock_of(BusConfig(interface="palpate", clock=path))
    with pytest.raises(ConfigError, match=r"bus\.interface is socketcan: remove"):
        clock_of(BusConfig(interface="socketcan", clock=path))
    with pytest.raises(ConfigError, match="give another path"):
        make_clock(tmp_path / "missing" / "clock")
