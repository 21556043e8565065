"""`bus budget` against the hub's own counting of real traffic, and against lengths worked out by hand."""

from __future__ import annotations

import gzip
import itertools
import re
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

from palpate_bus.cli.main import bus
from palpate_bus.hub import protocol
from palpate_bus.hub.hub_client import Client
from palpate_bus.hub.hub_core import HubCore
from palpate_bus.hub.protocol import Hello
from palpate_bus.load.bit_count import frame_bits
from palpate_bus.load.budget import (
    BudgetCase,
    budget,
    further_classic_frames,
    largest_frame_rate,
    largest_tick_rate,
    most_drives,
    on_classic_can,
    worst_bits,
)
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
        frame = protocol.send_messages([record.frame])
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


def test_on_can_fd_a_contact_is_one_frame_of_the_length_in_the_eds():
    """Without stuff bits it has 29 nominal and 38 + 8 n data bits (CRC-21), a drive's 29 and 33 + 8 n
    (CRC-17); TPDO 4, the time stamp, SYNC, heartbeats and SDO stay classic."""
    classic = BudgetCase(10, 15, 120, tick_Hz=250)
    fd = replace(classic, data_bitrate=5_000_000)
    by_name = {s.name: s for s in budget(fd).streams}
    contact, command = by_name.pop("fingertip TPDO 10"), by_name["drive RPDO 1"]
    assert (contact.length, contact.per_s) == (32, 10 * 120)
    assert contact.least == pytest.approx(29 + (38 + 8 * 32) / 5)
    assert command.least == pytest.approx(29 + (33 + 8 * 5) / 5)
    assert all(s.least <= s.mean <= s.worst for s in (contact, *by_name.values()))
    before = {s.name: s for s in budget(classic).streams}
    assert set(before) - set(by_name) == {f"fingertip TPDO {number}" for number in (1, 2, 3, 5)}
    drives = {name for name in by_name if name.startswith("drive")}
    assert {name: by_name[name] for name in by_name if name not in drives} == {
        name: before[name] for name in by_name if name not in drives
    }
    mixed = {s.name: s for s in budget(replace(fd, classic_drives=True)).streams}
    assert mixed == by_name | {name: before[name] for name in drives} | {"fingertip TPDO 10": contact}
    assert (budget(classic).verdict, budget(fd).verdict) == ("does not fit", "fits")


def test_on_can_fd_poses_make_the_frame_longer():
    by_name = {s.name: s for s in budget(BudgetCase(pose_fingertips=2, data_bitrate=5_000_000)).streams}
    plain, posed = by_name["fingertip TPDO 10"], by_name["fingertip TPDO 10, poses"]
    assert (plain.length, plain.per_s, posed.length, posed.per_s) == (32, 30, 64, 60)
    assert by_name["fingertip TPDO 4"].per_s == 3


def test_the_command_computes_a_can_fd_bus():
    hand = ["budget", "--fingertips", "10", "--drives", "15", "--fps", "120", "--tick", "250"]
    assert CliRunner().invoke(bus, hand).exit_code == 1
    shown = CliRunner().invoke(bus, [*hand, "--fd"])
    assert shown.exit_code == 0
    assert "fingertip TPDO 10" in shown.output and "FD at 5000 kbit/s" in shown.output
    assert CliRunner().invoke(bus, [*hand, "--fd", "--classic-drives"]).exit_code == 1


def test_five_axes_in_a_node_are_one_frame_each_way():
    """12 bytes an axis for the state, 4 for the command. Without stuff bits a frame of 64 bytes has 29
    nominal and 38 + 8 * 64 data bits, one of 20 bytes 29 and 38 + 8 * 20 (CRC-21)."""
    alone = BudgetCase(10, 15, 120, tick_Hz=250, data_bitrate=5_000_000)
    shared = alone.sharing_nodes(5)
    assert (shared.axis_nodes, shared.joints, shared.drives, shared.nodes) == ((5, 5, 5), 0, 15, 14)
    by_name = {s.name: s for s in budget(shared).streams}
    state, command = by_name["drive TPDO 1, 5 axes"], by_name["drive RPDO 1, 5 axes"]
    assert (state.length, state.per_s, command.length, command.per_s) == (64, 3 * 250, 20, 3 * 250)
    assert state.least == pytest.approx(29 + (38 + 8 * 64) / 5)
    assert command.least == pytest.approx(29 + (38 + 8 * 20) / 5)
    assert state.least <= state.mean <= state.worst and command.least <= command.mean <= command.worst
    assert budget(shared).mean_percent < 40 < budget(alone).mean_percent


def test_eight_axes_need_two_tpdos_and_the_rest_shares_a_node():
    shared = BudgetCase(3, 11, data_bitrate=5_000_000).sharing_nodes(8)
    assert shared.axis_nodes == (8, 3)
    assert {s.name: s.length for s in budget(shared).streams if s.name.startswith("drive")} == {
        "drive TPDO 1, 8 axes": 64,
        "drive TPDO 2, 8 axes": 48,  # 36 bytes
        "drive RPDO 1, 8 axes": 32,
        "drive TPDO 1, 3 axes": 48,
        "drive RPDO 1, 3 axes": 12,
    }


def test_axes_without_can_fd_are_refused():
    for options in (["--axes", "5"], ["--axes", "5", "--fd", "--classic-drives"]):
        refused = CliRunner().invoke(bus, ["budget", *options])
        assert refused.exit_code == 2 and "--axes needs --fd without --classic-drives" in refused.output


PAGE = Path(__file__).parents[3] / "docs/bus.md"
ROWS = re.findall(
    r"^\| `(--drives .*?)` \| ([0-9.]+) % \| ([0-9.]+) % \| (.*?) \|$", PAGE.read_text(), re.MULTILINE
)


@pytest.mark.parametrize(("options", "mean", "worst", "verdict"), ROWS)
def test_the_pages_figures(options, mean, worst, verdict):
    hand = ["budget", "--fingertips", "10", "--fps", "120", *options.split()]
    shown = CliRunner().invoke(bus, hand).output
    assert f"{mean} % mean, {worst} % at worst, {verdict}" in shown


def test_the_page_has_figures():
    assert len(ROWS) == 8


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


LARGE_FD = BudgetCase(10, 0, 120, 250, data_bitrate=5_000_000, axis_nodes=(5, 5, 5))


def test_the_same_hand_on_classic_can_has_a_node_for_each_drive():
    classic = on_classic_can(LARGE_FD)
    assert classic == BudgetCase(10, 15, 120, 250)


def fits(case):
    return budget(case).verdict == "fits"


@pytest.mark.parametrize("case", [on_classic_can(LARGE_FD), BudgetCase(10, 9, 120)], ids=["large", "small"])
def test_the_largest_tick_rate_of_a_hand_fits_and_a_faster_one_does_not(case):
    rate_Hz = largest_tick_rate(case)
    assert fits(replace(case, tick_Hz=0.999 * rate_Hz))
    assert not fits(replace(case, tick_Hz=1.001 * rate_Hz))


def test_a_long_burst_bounds_the_tick_rate():
    """Ten frames of 135 bits of each kind in one tick: 4 TPDOs take 5.4 ms, and SYNC 55 us."""
    case = BudgetCase(10, 0, 30)
    assert largest_tick_rate(case) == pytest.approx(1e6 / (10 * 4 * 135 + 55))
    assert not fits(replace(case, tick_Hz=190))


def test_the_most_drives_of_a_hand_fit_and_one_more_does_not():
    case = BudgetCase(10, 9, 120)
    count = most_drives(case)
    assert fits(replace(case, joints=count)) and not fits(replace(case, joints=count + 1))
    assert most_drives(on_classic_can(LARGE_FD)) is None


def test_further_classic_frames_fill_a_can_fd_bus_to_the_limit():
    room = further_classic_frames(budget(LARGE_FD))
    load_percent = budget(LARGE_FD).worst_percent + 100 * room * DAVIS[8] / 1e6
    assert load_percent == pytest.approx(80.0, abs=0.02)


@pytest.mark.long
def test_a_can_fd_budget_says_what_classic_can_carries():
    options = ["budget", "--fingertips", "10", "--fps", "120", "--fd", "--drives"]
    large = CliRunner().invoke(bus, [*options, "15", "--tick", "250", "--axes", "5"])
    text = " ".join(large.output.split())
    classic = budget(BudgetCase(10, 15, 120, 250))
    assert f"A bus of classic CAN with the same hand: {classic.mean_percent:.1f} % mean" in text
    assert "does not fit. It fits with drives at 30 Hz, the rest as above." in text
    text = " ".join(CliRunner().invoke(bus, [*options, "9"]).output.split())
    assert "with drives at 55 Hz, or with 5 drives at 100 Hz, or with cameras at 101 FPS" in text
    assert "classic CAN" not in CliRunner().invoke(bus, ["budget"]).output
