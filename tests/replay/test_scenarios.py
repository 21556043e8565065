"""What goes wrong on a bus, replayed: both sides answer exactly as before, and as docs/safety.md says.

Modes, times and reasons are worked out here from the configuration and from the frames of the log.
"""

from __future__ import annotations

import gzip
import importlib.util
import shutil
import struct
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from palpate_bus.logs.candump import format_record, parse_log
from palpate_bus.logs.pcap import write_pcap
from palpate_edge.node.id_conflict import QUIET_US
from palpate_host.common.mode import Mode
from palpate_host.service.contract import check_contract
from palpate_host.service.host import load_hand
from palpate_host.service.replay import replay

HERE = Path(__file__).parent
MEANT = "answers otherwise than before; if meant: python tests/replay/refresh.py"
LARGEST_BYTES = 300_000


def load(name):
    full = f"palpate_replay_{name}"
    if full not in sys.modules:
        spec = importlib.util.spec_from_file_location(full, HERE / f"{name}.py")
        sys.modules[full] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[full])
    return sys.modules[full]


scenarios, fingertip_rig = load("scenarios"), load("fingertip_rig")
TABLE_4 = Path(load.__code__.co_filename).parents[2] / "host" / "palpate_host" / "models" / "table4.toml"
NORMAL_MODES = (Mode.INIT, Mode.CHECK, Mode.READY, Mode.GRASP, Mode.MANIPULATE)


@cache
def hand():
    return load_hand(TABLE_4)


@cache
def log(name):
    path = HERE / f"{name}.log.gz"
    return parse_log(path, gzip.decompress(path.read_bytes()))


@cache
def replayed(name):
    """The host's replay of a scenario."""
    check_contract(HERE / f"{name}.log.gz", log(name).header, hand()[0])
    return replay(log(name).records, *hand())


def entered(name, mode):
    """When the host entered a mode last, and why."""
    return next(
        (change.time_us, change.reason) for change in replayed(name).changes[::-1] if change.mode is mode
    )


TICK_US = 10_000  # control.tick_Hz of table4.toml, 100


def last_exposure_us(name, node, before_us):
    """Of the node's last TPDO 3 before a time: the bus clock's 32 bits, on the log's clock."""
    sent = [r for r in log(name).records if r.frame.can_id == 0x380 + node and r.stamp_us < before_us][-1]
    (exposed,) = struct.unpack_from("<I", sent.frame.data)
    return sent.stamp_us - (sent.stamp_us - exposed) % (1 << 32)


def last_us(name, can_id, before_us):
    return [r.stamp_us for r in log(name).records if r.frame.can_id == can_id and r.stamp_us < before_us][-1]


def within_a_tick_after(time_us, limit_us):
    return limit_us < time_us <= limit_us + TICK_US


def lines(records):
    return [format_record(record) for record in records]


@pytest.mark.parametrize("name", scenarios.SCENARIOS)
def test_the_host_answers_exactly_as_before(name):
    golden = gzip.decompress((HERE / f"{name}.answers.log.gz").read_bytes()).decode().splitlines()
    assert lines(replayed(name).records) == [line for line in golden if line[0] != "#"], f"the host {MEANT}"


@pytest.mark.parametrize("name", [name for name in scenarios.SCENARIOS if name != "node-id-clash"])
def test_the_fingertip_answers_exactly_as_before(name):
    golden = gzip.decompress((HERE / f"{name}.fingertip.log.gz").read_bytes()).decode().splitlines()
    frames = fingertip_rig.fingertip_frames(name, log(name).records)
    assert lines(frames) == [line for line in golden if line[0] != "#"], f"the fingertip {MEANT}"


def test_the_fingertips_contacts_are_those_of_the_recorded_frames():
    """To what a change of the estimator may move them; how good they are is measured in docs/accuracy.md."""
    pairs = list(zip(fingertip_rig.estimate_frames(), fingertip_rig.read_contacts(), strict=True))
    other = [now for now, stored in pairs if (now.valid, now.in_contact) != (stored.valid, stored.in_contact)]
    assert len(other) <= 0.05 * len(pairs)
    both = [(n, s) for n, s in pairs if n.position_mm is not None and s.position_mm is not None]
    assert len(both) > 0.4 * len(pairs)
    for now, stored in both:
        assert now.position_mm == pytest.approx(stored.position_mm, abs=1.0)
        assert now.normal_force_N == pytest.approx(stored.normal_force_N, abs=0.3)


@pytest.mark.parametrize("path", sorted(HERE.glob("*.log.gz")), ids=lambda path: path.name)
def test_tshark_finds_nothing_malformed(tmp_path, path):
    assert path.stat().st_size < LARGEST_BYTES
    if shutil.which("tshark") is None:
        pytest.skip("tshark is missing: install it for a second opinion on every frame")
    records = parse_log(path, gzip.decompress(path.read_bytes())).records
    write_pcap(tmp_path / "x.pcap", records)
    command = ["tshark", "-r", str(tmp_path / "x.pcap"), "-d", "can.subdissector,canopen", "-T", "fields"]
    command += ["-e", "_ws.malformed", "-e", "_ws.col.Protocol"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.splitlines() == ["\tCANopen"] * len(records)


def test_start_up_waits_for_the_last_node():
    changes = replayed("start-up").changes
    assert [change.mode for change in changes] == [Mode.INIT, Mode.CHECK, Mode.READY, Mode.GRASP]
    boot_us = scenarios.START_US + scenarios.BOOT_DELAY_US
    operates_us = next(
        r.stamp_us for r in log("start-up").records if r.frame.can_id == 0x712 and r.frame.data == b"\x05"
    )
    assert operates_us > boot_us
    assert within_a_tick_after(changes[2].time_us, operates_us)
    assert "fingertip of finger-3" in changes[0].reason
    first_contact_us = next(
        r.stamp_us for r in log("start-up").records if r.frame.can_id == 0x392 and r.stamp_us > boot_us
    )
    assert within_a_tick_after(changes[3].time_us, first_contact_us)


def test_a_normal_grasp_turns_after_settling():
    config, _ = hand()
    assert replayed("normal").modes == NORMAL_MODES
    hold_us, manipulate_us = entered("normal", Mode.GRASP)[0], entered("normal", Mode.MANIPULATE)[0]
    assert manipulate_us - hold_us == config.control.settle_ms * 1000
    assert replayed("normal").status.last_emergency == ""


def test_a_lost_fingertip_goes_down_the_ladder_to_stop():
    name, tiers, network = "fingertip-lost", hand()[0].staleness, hand()[0].network
    exposed_us = last_exposure_us(name, scenarios.FINGER_3, scenarios.FAULT_US)
    beat_us = last_us(name, 0x700 + scenarios.FINGER_3, scenarios.FAULT_US)
    assert replayed(name).modes == (*NORMAL_MODES, Mode.BLIND, Mode.HOLD, Mode.FAULT)
    assert within_a_tick_after(entered(name, Mode.BLIND)[0], exposed_us + tiers.freeze_ms * 1000)
    assert within_a_tick_after(entered(name, Mode.HOLD)[0], beat_us + network.heartbeat_timeout_ms * 1000)
    stop_us, reason = entered(name, Mode.FAULT)
    assert within_a_tick_after(stop_us, exposed_us + tiers.stop_ms * 1000)
    assert reason == f"finger-3: no valid frame for more than {tiers.stop_ms} ms"
    stopping = [r.frame for r in replayed(name).records if r.stamp_us == stop_us]
    words = [f.data[:2] for f in stopping if f.can_id in range(0x201, 0x20A)]
    torques = [f.data[3:5] for f in stopping if f.can_id in range(0x201, 0x20A)]
    assert words == [b"\x02\x00"] * 9  # CiA 402: quick stop
    assert torques == [b"\x00\x00"] * 9


def test_a_fingertip_whose_camera_stops_withdraws_its_contact():
    """EMCY FF02h and cleared flags when the time-out of the configuration passes, once."""
    frames = fingertip_rig.fingertip_frames("fingertip-lost", log("fingertip-lost").records)
    seen_us = max(r.stamp_us for r in frames if r.frame.can_id == 0x291 and r.frame.data[6] & 4)
    (emcy,) = [r for r in frames if r.frame.can_id == 0x091]
    assert emcy.stamp_us == seen_us + fingertip_rig.CAMERA_TIMEOUT_US
    assert emcy.frame.data[:2] == b"\x02\xff"
    after = [r.frame.data[6] for r in frames if r.frame.can_id == 0x291 and r.stamp_us > seen_us]
    assert after == [0]


def test_a_fingertip_off_the_bus_comes_back_and_the_hand_goes_on():
    name, config = "bus-off", hand()[0]
    exposed_us = last_exposure_us(name, scenarios.FINGER_2, scenarios.FAULT_US)
    beat_us = last_us(name, 0x700 + scenarios.FINGER_2, scenarios.FAULT_US)
    assert replayed(name).modes == (*NORMAL_MODES, Mode.BLIND, Mode.HOLD, Mode.MANIPULATE)
    assert within_a_tick_after(entered(name, Mode.BLIND)[0], exposed_us + config.staleness.freeze_ms * 1000)
    hold_us = entered(name, Mode.HOLD)[0]
    assert within_a_tick_after(hold_us, beat_us + config.network.heartbeat_timeout_ms * 1000)
    read_us = max(r.stamp_us for r in log(name).records if r.frame.can_id == 0x580 + scenarios.FINGER_2)
    assert read_us > hold_us  # read again, since its heartbeat was lost
    contact_us = next(
        r.stamp_us for r in log(name).records if r.frame.can_id == 0x391 and r.stamp_us > read_us
    )
    assert within_a_tick_after(entered(name, Mode.MANIPULATE)[0], contact_us)
    assert contact_us - hold_us > config.control.settle_ms * 1000


def test_a_fingertip_back_from_bus_off_says_so_and_waits_to_be_started():
    """1029h by default: pre-operational after a communication error; CiA 301: EMCY 8140h, then its reset."""
    frames = fingertip_rig.fingertip_frames("bus-off", log("bus-off").records)
    back_us = scenarios.START_US + 1 + fingertip_rig.BUS_OFF_US["bus-off"][1]
    after = [r for r in frames if r.stamp_us >= back_us - 1]
    codes = [r.frame.data[:2].hex() for r in after if r.frame.can_id == 0x091]
    assert codes == ["4081", "0000"]
    assert {r.frame.data for r in after if r.frame.can_id == 0x711} == {b"\x7f"}
    assert not [r for r in after if r.frame.can_id in (0x191, 0x291, 0x391, 0x491)]


def test_a_host_that_hears_nobody_stops_within_a_joints_deadline():
    name, config = "host-cut-off", hand()[0]
    heard_us = last_us(name, 0x181, scenarios.FAULT_US)
    stop_us, reason = entered(name, Mode.FAULT)
    assert within_a_tick_after(stop_us, heard_us + config.staleness.joint_stop_ms * 1000)
    assert reason.endswith(f"no position for more than {config.staleness.joint_stop_ms} ms")
    stopped = {
        r.frame.data[1] for r in replayed(name).records if r.frame.can_id == 0 and r.frame.data[0] == 2
    }
    assert stopped == {*range(1, 10), *scenarios.TIPS}  # NMT stop to everybody, at last


def test_late_contacts_are_taken_and_nothing_stops():
    """At most 40 ms late: below the first tier (warn_ms 120)."""
    assert replayed("late").modes == NORMAL_MODES
    complete = [finger.complete for finger in replayed("late").status.fingers]
    assert complete == pytest.approx([finger.complete for finger in replayed("normal").status.fingers], abs=2)
    assert replayed("late").status.warning == ""


def test_doubled_frames_change_nothing_and_are_counted():
    twice = len(log("duplicated").records) - len(log("normal").records)
    assert replayed("duplicated").records == replayed("normal").records
    counted = sum(finger.duplicates for finger in replayed("duplicated").status.fingers)
    assert 0 < counted <= twice
    assert counted > 0.9 * twice  # a few belong to frames before the host's reset


def whole_frames(name, node):
    """Return how many frames of the node have all four parts in the log, before the host's last status.

    Parts stand 1 us apart.
    """
    stamps = {base: set() for base in scenarios.CONTACT_TPDOS}
    for record in log(name).records:
        if is_part(record, node) and record.stamp_us <= replayed(name).status.time_us:
            stamps[record.frame.can_id - node].add(record.stamp_us)
    first, *others = (stamps[base] for base in scenarios.CONTACT_TPDOS)
    return sum(all(at + place in found for place, found in enumerate(others, start=1)) for at in first)


def is_part(record, node):
    return record.frame.can_id - node in scenarios.CONTACT_TPDOS


def test_lost_frames_cost_their_contact_and_no_other():
    assert replayed("lossy").modes == NORMAL_MODES
    for node, finger in zip(scenarios.TIPS, replayed("lossy").status.fingers, strict=True):
        assert finger.complete == finger.extra_tpdos == whole_frames("lossy", node)
        assert finger.incomplete > 0
        assert finger.extra_missing > 0


def test_a_fingertip_without_tpdo_5_gives_whole_contacts():
    """finger-3 is of an older version: the host does as with the others, and knows no radius."""
    records = [r for r in log("normal").records if r.frame.can_id != 0x300 + scenarios.FINGER_3]
    older = replay(records, *hand())
    assert older.records == replayed("normal").records
    assert [finger.radius95_mm for finger in older.status.fingers] == [0.35, 0.35, None]
    assert [finger.extra_tpdos > 0 for finger in older.status.fingers] == [True, True, False]
    assert older.status.fingers[2].complete == replayed("normal").status.fingers[2].complete


def test_overtaken_parts_are_never_mixed():
    """Up to 8 ms of disorder: what is torn is left out, at worst the frame is frozen; no other mode."""
    assert set(replayed("reordered").modes[4:]) <= {Mode.MANIPULATE, Mode.BLIND}
    assert sum(finger.out_of_order for finger in replayed("reordered").status.fingers) > 0
    freeze_us = hand()[0].staleness.freeze_ms * 1000
    reasons = {change.reason for change in replayed("reordered").changes if change.mode is Mode.BLIND}
    assert all(reason.endswith(f"contact older than {freeze_us // 1000} ms") for reason in reasons)


def test_a_node_id_used_twice_is_told_by_the_fingertip_which_sends_no_valid_contact_meanwhile():
    records = log("node-id-clash").records
    sent = fingertip_rig.fingertip_frames("node-id-clash", records)
    boot_us = max(r.stamp_us for r in records if r.frame.can_id == 0x711 and r.frame.data == b"\0")
    emergencies = [r.frame.data for r in sent if r.frame.can_id == 0x091 and r.stamp_us >= boot_us]
    assert emergencies == [bytes.fromhex("5081111107000000")]  # 8150h, by frame 0x711
    silent = [r.frame for r in sent if boot_us <= r.stamp_us < boot_us + QUIET_US]
    contacts = [frame for frame in silent if frame.can_id == 0x291]
    assert [frame.data[6] for frame in contacts] == [0]  # the withdrawal


def test_a_node_id_used_twice_stops_the_hand():
    """Two devices send contacts as finger-2: few of them are believed, soon the hand stops and says why."""
    stop_us, reason = entered("node-id-clash", Mode.FAULT)
    assert reason.startswith("finger-2: two devices send as node 0x11")
    assert stop_us - scenarios.FAULT_US < 1_000_000  # 430 ms of them to read the one that booted


def test_a_storm_of_emergencies_moves_no_joint():
    assert replayed("emcy-storm").records == replayed("normal").records
    assert replayed("emcy-storm").status.counters.emergencies == scenarios.STORM_FRAMES
    assert replayed("emcy-storm").status.last_emergency.endswith("EMCY FF01h")


def test_a_jittering_sync_stops_nothing():
    """3 ms of 10: every joint is still fresh (joint_stop_ms 100)."""
    assert replayed("sync-jitter").modes == NORMAL_MODES
    assert replayed("sync-jitter").status.counters.late_ticks == 0


def exposures_us(name):
    frames = fingertip_rig.fingertip_frames(name, log(name).records)
    return [struct.unpack_from("<I", r.frame.data)[0] for r in frames if r.frame.can_id == 0x391]


def test_a_jittering_sync_moves_the_fingertips_clock_by_less_than_the_jitter():
    """SYNC comes 0 to 3 ms late, 1013h tells when it left: soon the lateness is filtered out."""
    moved = [abs(a - b) for a, b in zip(exposures_us("sync-jitter"), exposures_us("normal"), strict=True)]
    assert 0 < max(moved) <= 3_000
    assert max(moved[15:]) < 600


@pytest.mark.parametrize("name", ["late", "duplicated", "reordered", "lossy", "emcy-storm"])
def test_what_befalls_others_does_not_touch_a_fingertip(name):
    """The host's frames are the normal ones in these logs, so finger-2 sends the same; one log is longer."""
    normal = fingertip_rig.fingertip_frames("normal", log("normal").records)
    frames = fingertip_rig.fingertip_frames(name, log(name).records)
    assert len(frames) >= len(normal) and lines(frames)[: len(normal)] == lines(normal)
