"""`bus budget` against the hub's own counting of real traffic, and against lengths worked out by hand."""

from __future__ import annotations

import gzip
import itertools
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.cli.main import bus
from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import Hello, Kind
from palpate_bus.load.bit_count import frame_bits
from palpate_bus.load.budget import BudgetCase, budget, largest_frame_rate, worst_bits
from palpate_bus.logs.candump import read_log
from palpate_edge.can_bus.can_frame import CanFrame

GOLDEN = Path(__file__).parents[2] / "replay" / "demo.log.gz"
# Lengths worked out in Davis et al. (2007), table of transmission times: 8 bytes take 135 bits at most.
DAVIS = {0: 55, 1: 65, 2: 75, 3: 85, 4: 95, 5: 105, 6: 115, 7: 125, 8: 135}


@pytest.mark.parametrize(("length", "bits"), DAVIS.items())
def test_worst_case_is_the_published_one(length, bits):
    assert worst_bits(length) == bits


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_no_frame_is_longer_than_the_worst_case(can_id, data):
    assert frame_bits(CanFrame(can_id, data)) <= worst_bits(len(data))


def test_a_hand_counted_by_hand():
    """3 fingertips at 30 FPS, 9 drives and the host at 100 Hz, as docs/bus.md says who sends what."""
    by_name = {s.name: s for s in budget(BudgetCase()).streams}
    assert {name: (s.length, s.per_s) for name, s in by_name.items()} == {
        "fingertip TPDO 1": (8, 3 * 30),
        "fingertip TPDO 2": (8, 3 * 30),
        "fingertip TPDO 3": (8, 3 * 30),
        "fingertip TPDO 4": (7, 3),
        "fingertip TPDO 5": (8, 3 * 30),
        "time stamp": (4, 20),
        "drive TPDO 1": (8, 9 * 100),
        "drive TPDO 2": (5, 9 * 10),
        "drive RPDO 1": (5, 9 * 100),
        "SYNC": (0, 100),
        "heartbeats": (1, 13 * 10),
        "SDO reserve": (8, 40),
    }
    assert all(47 + 8 * s.length <= s.mean <= DAVIS[s.length] == s.worst for s in by_name.values())


def test_poses_are_four_more_frames_of_each_such_fingertip():
    plain, posed = budget(BudgetCase()), budget(BudgetCase(pose_fingertips=2))
    added = {s.name: (s.length, s.per_s) for s in posed.streams}
    for stream in plain.streams:
        del added[stream.name]
    assert added == {f"fingertip TPDO {number}": (8, 2 * 30) for number in (6, 7, 8, 9)}
    assert posed.worst_percent - plain.worst_percent == pytest.approx(100 * 4 * 60 * 135 / 1e6)
    assert posed.burst_us - plain.burst_us == pytest.approx(4 * 2 * 135)


def hub_measures(records, bitrate):
    """The records through a hub at their own times: (bits, duration us) as the hub counts them."""
    hub = HubCore(bitrate, 4096, records[0].stamp_us)
    sender = Client()
    hub.receive(sender, protocol.hello_message(Hello("log", 0, False, False)), records[0].stamp_us)
    for record in records:
        hub.advance(record.stamp_us)
        frame = protocol.message(Kind.SEND, protocol.pack_frame(record.frame))
        hub.receive(sender, frame, record.stamp_us)
    end_us = records[-1].stamp_us
    hub.advance(end_us + 1_000_000)
    return hub.statistics(end_us).bits, end_us - records[0].stamp_us


def steady(records):
    """From the first torque command on: everybody operates."""
    begin = next(i for i, r in enumerate(records) if r.frame.can_id == 0x201 and r.frame.data[:1] == b"\x0f")
    kept = records[begin:]
    ends = [i for i, r in enumerate(kept) if r.frame.can_id == 0x000]  # NMT stop, when the run ends
    return kept[: ends[0]] if ends else kept


def time_stamps_per_s(records):
    return sum(r.frame.can_id == 0x1FF for r in records) * 1e6 / (records[-1].stamp_us - records[0].stamp_us)


def compare(records):
    """The demo's traffic as the hub measures it against the budget of that hand; the ratio."""
    bits, duration_us = hub_measures(records, 1_000_000)
    case = BudgetCase(time_stamps_per_s=time_stamps_per_s(records), sdo_per_s=0)
    return budget(case).mean_percent / (100 * bits / duration_us)


def test_the_budget_is_within_5_percent_of_what_the_hub_measures(tmp_path):
    """demo.log.gz is what the demo's real processes said on the hub."""
    path = tmp_path / "demo.log"
    path.write_bytes(gzip.decompress(GOLDEN.read_bytes()))
    ratio = compare(steady(read_log(path).records))
    assert 0.95 < ratio < 1.05, ratio


@pytest.mark.demo
def test_a_running_hand_is_within_5_percent_of_its_budget(real_time_demo):
    """Three daemons, nine drives and the host."""
    folder, _ = real_time_demo
    records = steady(read_log(folder / "run" / "bus.log").records)
    assert records[-1].stamp_us - records[0].stamp_us > 3_000_000
    ratio = compare(records)
    assert 0.95 < ratio < 1.05, ratio


def test_verdicts_follow_the_load():
    assert budget(BudgetCase(3, 9, 30)).verdict == "fits"
    assert budget(BudgetCase(3, 9, 120)).verdict == "fits"
    assert budget(BudgetCase(3, 15, 30)).verdict == "fits"
    assert budget(BudgetCase(3, 15, 120)).verdict == "fits"
    assert budget(BudgetCase(10, 0, 120)).verdict == "fits"
    assert budget(BudgetCase(10, 30, 120)).verdict == "does not fit"
    assert budget(BudgetCase(60, 70, 1, tick_Hz=1)).verdict == "does not fit"  # more than 127 nodes
    assert budget(BudgetCase(3, 9, 30, bitrate=250_000)).verdict == "does not fit"


def test_more_of_anything_is_more_load():
    loads = [
        budget(BudgetCase(f, 3 * f, fps)).worst_percent for f, fps in itertools.product((1, 2, 4), (10, 60))
    ]
    assert loads == sorted(loads)
    assert budget(BudgetCase(bitrate=500_000)).mean_percent == pytest.approx(
        2 * budget(BudgetCase()).mean_percent
    )


def test_the_largest_frame_rate_just_fits():
    rate = largest_frame_rate(BudgetCase())
    assert budget(BudgetCase(frames_per_s=rate)).worst_percent == pytest.approx(80.0)
    assert largest_frame_rate(BudgetCase(fingertips=0)) == 0
    assert largest_frame_rate(BudgetCase(10, 40)) == 0


def test_the_command_draws_and_its_status_says_whether_it_fits():
    shown = CliRunner().invoke(bus, ["budget"])
    assert shown.exit_code == 0
    assert "fingertip TPDO 1" in shown.output and "█" in shown.output
    over = CliRunner().invoke(bus, ["budget", "--fingertips", "10", "--fps", "120"])
    assert over.exit_code == 1
    assert "does not fit" in over.output
