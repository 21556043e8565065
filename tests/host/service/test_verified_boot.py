"""Verified boot: no contact of a fingertip counts before the host has read what it decodes with."""

import itertools

import msgspec
import pytest

from palpate_bus.logs.candump import LogRecord
from palpate_edge.can_bus.can_frame import CanFrame
from palpate_edge.node.eds import load_eds
from palpate_edge.node.fingertip import FingertipNode
from palpate_edge.node.fingertip_objects import MethodCode
from palpate_edge.node.parsed_eds import FINGERTIP_EDS
from palpate_edge.node.stored_parameters import StoredParameters
from palpate_host.common.command import Accept, Accepted, CommandError
from palpate_host.common.mode import Mode
from palpate_host.network.configuration_signature import signature_of
from palpate_host.network.fingertip_contract import fingertip_contract
from palpate_host.service.replay import replay

TIP = 0x10
VERSION = str(load_eds(FINGERTIP_EDS, TIP).entry(0x100A).default)
SWAPPED = {(0x1A00, 1): 0x7130_0210, (0x1A00, 2): 0x7130_0110}  # y before x, as long as before
PLACE_MM = (5.0, -8.0, 28.5)
READ_S = 0.6  # 47 ticks of 10 ms to read and sign a fingertip, and its first frame


def stored(objects):
    """What a node has after these objects were written and saved."""
    od = load_eds(FINGERTIP_EDS, TIP)
    return StoredParameters(eds_checksum=od.checksum, objects=objects)


def tip_with(objects, calibration="0" * 16, serial=0):
    kept = stored(objects)
    return FingertipNode(TIP, MethodCode.CORRECTED, calibration, serial_number=serial, kept=kept)


def with_finger(config, **values):
    first = msgspec.structs.replace(config.fingers[0], **values)
    return msgspec.structs.replace(config, fingers=(first, *config.fingers[1:]))


@pytest.fixture
def rig(bench, table_4):
    return bench.VirtualBench(*table_4, feel=lambda *_: PLACE_MM)


def sdo_write(rig, key, value, size, heard=True):
    """A request of another SDO client reaches the fingertip and, if `heard`, the host."""
    command = {1: 0x2F, 4: 0x23}[size]
    data = bytes((command, *key[0].to_bytes(2, "little"), key[1])) + value.to_bytes(4, "little")
    frame = CanFrame(0x600 + TIP, data)
    rig._to_nodes.append(frame)
    if heard:
        rig.host_queue.append((rig.now_us, frame))


def nmt(rig, command):
    frame = CanFrame(0, bytes((command, TIP)))
    rig._to_nodes.append(frame)
    rig.host_queue.append((rig.now_us, frame))


def remap(rig, words, heard=True):
    """Map TPDO 1 in the steps of CiA 301."""
    for key, value, size in (
        ((0x1800, 1), 0xC000_0190, 4),
        ((0x1A00, 0), 0, 1),
        *((key, word, 4) for key, word in words.items()),
        ((0x1A00, 0), 4, 1),
        ((0x1800, 1), 0x4000_0190, 4),
    ):
        sdo_write(rig, key, value, size, heard)
        rig.run(0.002)


def positions(rig):
    return {s.fingers[0].position_mm for s in rig.statuses if s.fingers[0].position_mm is not None}


def test_a_stored_remap_stays_in_check_with_the_object_named(rig):
    rig.tips[0] = tip_with(SWAPPED)
    status = rig.run(2.5)
    assert status.mode is Mode.CHECK
    assert status.reason == (
        "waiting for fingertip of finger-1 (node 0x10): 1A00h:01 is 0x71300210, expected 0x71300110:"
        " palpate-host bus sdo restore 0x10"
    )
    assert not positions(rig)
    assert all(joint.command_Nm == 0.0 for joint in status.joints)


def test_a_remap_that_another_client_undoes_is_accepted_without_a_command(rig):
    rig.tips[0] = tip_with(SWAPPED)
    assert rig.run(1.0).mode is Mode.CHECK
    remap(rig, {(0x1A00, 1): 0x7130_0110, (0x1A00, 2): 0x7130_0210})
    assert rig.run(2.0).mode is Mode.MANIPULATE
    assert positions(rig) == {PLACE_MM}


@pytest.mark.parametrize(
    ("objects", "named"),
    [
        ({(0x1800, 1): 0xC000_0190}, "1800h:01 is 0xC0000190, expected 0x40000190"),
        ({(0x1802, 1): 0x4000_03A1}, "1802h:01 is 0x400003A1, expected 0x40000390"),
        ({(0x1801, 2): 1}, "1801h:02 is 0x1, expected 0xFE"),
        ({(0x1803, 1): 0x4000_04A1}, "1803h:01 is 0x400004A1, expected 0x40000490"),
        ({(0x1A01, 0): 4}, "1A01h:00 is 0x4, expected 0x5"),
        ({(0x1A04, 2): 0x7130_0910, (0x1A04, 3): 0x7130_0810}, "1A04h:02 is 0x71300910"),
        ({(0x1400, 1): 0x1FE}, "1400h:01 is 0x1FE, expected 0x1FF"),
        ({(0x1805, 1): 0x4000_01B0, (0x1A05, 2): 0x7130_0C10}, "1A05h:02 is 0x71300C10"),
    ],
)
def test_every_parameter_of_a_pdo_that_the_host_uses_is_named(rig, objects, named):
    rig.tips[0] = tip_with(objects)
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert f"fingertip of finger-1 (node 0x10): {named}" in status.reason
    assert "palpate-host bus sdo restore 0x10" in status.reason


@pytest.mark.parametrize(
    "objects",
    [{(0x1804, 1): 0xC000_0310}, {(0x1800, 2): 255}, {(0x1800, 3): 10}, {(0x1017, 0): 200}],
    ids=["TPDO 5 disabled", "event type of the profile", "inhibit time", "heartbeat"],
)
def test_what_a_person_may_change_is_accepted(rig, objects):
    rig.tips[0] = tip_with(objects)
    assert rig.run(2.0).mode is Mode.MANIPULATE


def test_another_software_version_is_named(rig, bench):
    tip = bench.make_tip(TIP)
    tip.slave.write(0x100A, 0, "0.0.9 of another make")
    rig.tips[0] = tip
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    version = load_eds(FINGERTIP_EDS, TIP).entry(0x100A).default
    assert f"100Ah:00 is '0.0.9 of another make', expected '{version}': install palpate" in status.reason


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (
            {"calibration": "0123456789abcdef"},
            "2001h:00 is 'fedcba9876543210', expected '0123456789abcdef': start it with that calibration",
        ),
        ({"serial": 0x2B}, "1018h:04 is 0x2A, expected 0x2B: connect that fingertip"),
        ({"calibration": "fedcba9876543210", "serial": 0x2A}, ""),
    ],
    ids=["calibration", "serial", "both right"],
)
def test_another_fingertip_than_hand_toml_names(bench, table_4, values, reason):
    config, hand = table_4
    rig = bench.VirtualBench(with_finger(config, **values), hand)
    rig.tips[0] = tip_with({}, calibration="fedcba9876543210", serial=0x2A)
    status = rig.run(2.0)
    assert status.mode is (Mode.CHECK if reason else Mode.MANIPULATE)
    assert reason in status.reason


@pytest.mark.parametrize(
    ("values", "accepted"),
    [
        ({"calibration": "0" * 15 + "1"}, Accepted("finger-1", "calibration", "f" * 16, "0" * 15 + "1")),
        ({"software": "0.0.9"}, Accepted("finger-1", "software", VERSION, "0.0.9")),
        ({"serial": 0x2B}, Accepted("finger-1", "serial", 0x2A, 0x2B)),
    ],
    ids=["calibration", "software", "serial"],
)
def test_another_fingertip_is_used_after_it_was_accepted(bench, table_4, values, accepted):
    """The other objects are still compared, and the signature is that of what was accepted."""
    config, hand = table_4
    rig = bench.VirtualBench(with_finger(config, **values), hand)
    rig.tips[0] = tip_with({}, calibration="f" * 16, serial=0x2A)
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert status.reason.endswith("or use this one: palpate-host command accept 0x10")
    assert rig.core.command(Accept(TIP)) == accepted
    assert rig.run(1.5).mode is Mode.MANIPULATE
    expected = (
        {"serial": None, "calibration": None, "software": None} | values | {accepted.key: accepted.value}
    )
    date, _ = signature_of(fingertip_contract(TIP, **expected))
    assert rig.tips[0].slave.read(SIGNATURE, 1) == date.value


def test_a_swapped_map_is_not_accepted(rig):
    rig.tips[0] = tip_with(SWAPPED)
    rig.run(1.0)
    with pytest.raises(
        CommandError, match=r"only another calibration.*1A00h:01 .*palpate-host bus sdo restore"
    ):
        rig.core.command(Accept(TIP))
    assert rig.run(2.0).mode is Mode.CHECK


def test_drives_and_fingertips_without_a_difference_are_not_accepted(bench, table_4):
    config, hand = table_4
    rig = bench.VirtualBench(with_finger(config, software="0.0.9"), hand)
    rig.run(1.0)
    for node_id in (1, TIP + 1, 0x7E):
        with pytest.raises(
            CommandError, match=f"node 0x{node_id:02X}: only another .* no difference was found"
        ):
            rig.core.command(Accept(node_id))


def test_a_moving_hand_accepts_nothing(rig):
    rig.run(1.5)
    with pytest.raises(CommandError, match=r"accept is refused in mode manipulate .*only the mode check"):
        rig.core.command(Accept(TIP))


def test_a_fingertip_that_boots_while_the_hand_turns_is_read_before_its_contacts_count(rig):
    assert rig.run(1.5).mode is Mode.MANIPULATE
    rig.tips[0] = tip_with(SWAPPED)
    rig.wake(TIP)
    began = len(rig.statuses)
    status = rig.run(2.0)
    assert positions(rig) == {PLACE_MM}
    assert status.mode is Mode.HOLD and "1A00h:01 is 0x71300210" in status.reason
    assert Mode.MANIPULATE not in {s.mode for s in rig.statuses[began + 30 :]}
    rig.run(4.0)
    assert rig.output.finished
    assert (
        "no valid frame for more than 3000 ms (fingertip of finger-1 (node 0x10): 1A00h" in rig.output.failure
    )


def test_an_equal_fingertip_that_boots_while_the_hand_turns_is_taken_into_use_again(rig, bench):
    rig.run(1.5)
    rig.tips[0] = bench.make_tip(TIP)
    rig.wake(TIP)
    rig.run(0.1)
    taken = rig.statuses[-1].fingers[0].complete
    rig.run(0.2)
    assert rig.statuses[-1].fingers[0].complete == taken
    assert rig.run(READ_S).fingers[0].complete > taken


def test_a_remap_of_a_running_fingertip_is_refused(rig):
    """Another client writes 1A00h while the fingertip is operational: the host reads it again."""
    rig.run(1.5)
    remap(rig, SWAPPED)
    status = rig.run(1.0)
    assert positions(rig) == {PLACE_MM}
    assert status.fingers[0].unverified > 0
    assert status.mode is Mode.MANIPULATE


def test_a_remap_in_pre_operational_by_another_master_is_found(rig):
    rig.run(1.5)
    nmt(rig, 0x80)
    rig.run(0.002)
    remap(rig, SWAPPED, heard=False)
    nmt(rig, 0x01)
    status = rig.run(1.0)
    assert positions(rig) == {PLACE_MM}
    assert "1A00h:01 is 0x71300210" in status.reason


def test_a_stopped_fingertip_is_made_to_answer(rig):
    rig.run(1.5)
    nmt(rig, 0x02)
    assert rig.run(2.0).mode is Mode.MANIPULATE
    assert CanFrame(0, bytes((0x80, TIP))) in [frame for _, frame in rig.log]


def test_a_fingertip_that_answers_no_sdo_request_is_named_within_a_second(bench, table_4):
    def deaf(stamp_us, frame):
        return [] if frame.can_id == 0x580 + TIP else [(stamp_us, frame)]

    rig = bench.VirtualBench(*table_4, to_host=deaf)
    rig.run(0.9)
    assert rig.statuses[-1].reason == "waiting for fingertip of finger-1 (node 0x10)"
    status = rig.run(0.2)
    assert status.mode is Mode.CHECK
    assert status.reason == (
        "waiting for fingertip of finger-1 (node 0x10): no SDO response to a read of 1020h:01 for 1 s:"
        " check the node, palpate-host bus scan"
    )
    rig.to_host = bench.same
    assert rig.run(2.0).mode is Mode.MANIPULATE


def test_lost_responses_are_asked_for_again(bench, table_4):
    answers = itertools.count()

    def every_tenth(stamp_us, frame):
        is_lost = frame.can_id == 0x580 + TIP and next(answers) % 10 == 0
        return [] if is_lost else [(stamp_us, frame)]

    rig = bench.VirtualBench(*table_4, to_host=every_tenth)
    assert rig.run(2.6).mode is Mode.MANIPULATE


def test_a_log_of_a_host_that_reads_is_replayed_and_one_of_a_host_that_does_not(rig, table_4):
    rig.run(1.5)
    records = [LogRecord(*entry) for entry in rig.log]
    sent = [record.frame for record in records if record.frame.can_id == 0x600 + TIP]
    result = replay(records, *table_4)
    assert result.modes[-1] is Mode.MANIPULATE
    assert [r.frame for r in result.records if r.frame.can_id == 0x600 + TIP] == sent
    transfers = {base + tip for base in (0x580, 0x600) for tip in (0x10, 0x11, 0x12)}
    older = [record for record in records if record.frame.can_id not in transfers]
    result = replay(older, *table_4)
    assert result.modes[-1] is Mode.MANIPULATE
    assert not [r for r in result.records if r.frame.can_id in transfers]


def test_reading_takes_no_more_than_a_request_a_tick(rig):
    rig.run(1.0)
    requests = [stamp for stamp, frame in rig.log if frame.can_id == 0x600 + TIP]
    assert len(set(requests)) == len(requests)
    # 43 objects; before them one of the signature and 1010h, behind them three that write and save it
    assert len(requests) == 48


def test_the_objects_of_the_contract_are_in_the_eds():
    od = load_eds(FINGERTIP_EDS, TIP)
    for wanted in fingertip_contract(TIP, serial=1, calibration="0" * 16):
        assert wanted.key in od.entries


DRIVE_MAPPINGS = [
    ({(0x1A00, 1): 0x606C_0020, (0x1A00, 2): 0x6064_0020}, "1A00h:01 is 0x606C0020, expected 0x60640020"),
    ({(0x1A01, 1): 0x6077_0010, (0x1A01, 3): 0x6041_0010}, "1A01h:01 is 0x60770010, expected 0x60410010"),
    ({(0x1600, 3): 0x6042_0010}, "1600h:03 is 0x60420010, expected 0x60710010"),
    ({(0x1400, 1): 0x203}, "1400h:01 is 0x203, expected 0x202"),
]


@pytest.mark.parametrize(("objects", "named"), DRIVE_MAPPINGS)
def test_a_remapped_drive_is_not_started(rig, objects, named):
    """Position and velocity of TPDO 1 exchanged, for one: both have 4 bytes."""
    rig.drives[1].slave.write_all(objects)
    rig.drives[1].slave._store.saved = objects  # as a drive that keeps them through the host's reset
    status = rig.run(1.0)
    assert status.mode is Mode.CHECK
    assert f"drive of flexion_1 (node 0x02): {named}: palpate-host bus sdo restore 0x02" in status.reason
    assert CanFrame(0, b"\x01\x02") not in [frame for _, frame in rig.log]


def test_drives_are_read_in_the_time_of_a_fingertip(rig):
    rig.run(1.0)
    first = next(status.time_us for status in rig.statuses if status.mode is Mode.READY)
    assert first - rig.statuses[0].time_us <= 560_000  # 47 ticks, the node's start, its heartbeat
    reads = [
        f
        for _, f in rig.log
        if f.can_id == 0x602 and f.data[0] == 0x40 and f.data[2] in (0x14, 0x16, 0x18, 0x1A)
    ]
    assert len(reads) == 14


SIGNATURE = 0x1020


def requests_to_tip(rig, since_us=0):
    """Index, sub-index and kind of the host's SDO requests to the first fingertip."""
    sent = [f.data for stamp, f in rig.log if f.can_id == 0x600 + TIP and stamp >= since_us]
    return [(int.from_bytes(data[1:3], "little"), data[3], data[0] >> 5) for data in sent]


def boot_again(rig):
    """The fingertip boots: its power was off for a moment."""
    kept = rig.tips[0].slave._keeper.kept
    rig.tips[0] = FingertipNode(TIP, MethodCode.CORRECTED, "0" * 16, kept=kept)
    rig.wake(TIP)
    rig.log.clear()


def test_a_verified_fingertip_is_signed_and_saved_before_it_is_started(rig):
    rig.run(1.0)
    assert requests_to_tip(rig)[-3:] == [(SIGNATURE, 1, 1), (SIGNATURE, 2, 1), (0x1010, 2, 1)]
    slave = rig.tips[0].slave
    date, time = slave.read(SIGNATURE, 1), slave.read(SIGNATURE, 2)
    assert 0 < date <= 0xFFFF and 0 <= time < 24 * 3600 * 1000  # a date and a time of day, as CiA 301 has it
    assert dict(slave._keeper.kept.objects) == {(SIGNATURE, 1): date, (SIGNATURE, 2): time}
    assert {tip.slave.read(SIGNATURE, 1) for tip in rig.tips} - {date}  # node ids are part of it


def test_a_fingertip_that_cannot_save_is_not_signed(bench, table_4):
    """Without `node.parameters` 1010h:02 is 0: in CiA 301 a device that does not save on command."""
    rig = bench.VirtualBench(*table_4)
    rig.tips[0] = FingertipNode(TIP, MethodCode.CORRECTED, "0" * 16, stores=False)
    assert rig.run(1.5).mode is Mode.MANIPULATE
    requests = requests_to_tip(rig)
    assert (0x1010, 2, 2) in requests
    assert [request for request in requests if request[2] == 1] == []


def test_a_signed_fingertip_is_read_in_two_requests(rig):
    rig.run(1.5)
    boot_again(rig)
    taken = rig.statuses[-1].fingers[0].complete
    assert rig.run(0.2).fingers[0].complete > taken
    assert requests_to_tip(rig) == [(SIGNATURE, 1, 2), (SIGNATURE, 2, 2)]


def test_a_signed_hand_is_ready_sooner(rig, bench, table_4):
    def ready_after_us(rig):
        rig.run(1.0)
        return next(s.time_us for s in rig.statuses if s.mode is Mode.READY) - rig.statuses[0].time_us

    again = bench.VirtualBench(*table_4)
    first_us = ready_after_us(rig)
    again.tips = rig.tips
    for tip in again.tips:
        tip.slave.process(bench.START_US, (CanFrame(0, b"\x81\x00"),))
    again_us = ready_after_us(again)
    print(f"READY after {first_us / 1e6:.2f} s, with signatures after {again_us / 1e6:.2f} s")
    assert first_us - again_us >= 250_000


def test_a_remap_of_a_signed_fingertip_is_read_whole(rig):
    """The node drops its signature with the change, whether the host receives the writes or not."""
    rig.run(1.5)
    nmt(rig, 0x80)
    rig.run(0.002)
    remap(rig, SWAPPED, heard=False)
    sdo_write(rig, (0x1010, 1), int.from_bytes(b"save", "little"), 4, heard=False)
    rig.run(0.01)
    boot_again(rig)
    status = rig.run(1.0)
    assert "1A00h:01 is 0x71300210" in status.reason
    assert len(requests_to_tip(rig)) > 10


def test_a_signature_of_another_contract_is_read_whole_and_replaced(bench, table_4):
    """The same fingertip, which hand.toml names by its calibration from now on."""
    rig = bench.VirtualBench(*table_4)
    rig.run(1.0)
    kept = rig.tips[0].slave._keeper.kept
    config, hand = table_4
    other = bench.VirtualBench(with_finger(config, calibration="0" * 16), hand)
    other.tips[0] = FingertipNode(TIP, MethodCode.CORRECTED, "0" * 16, kept=kept)
    assert other.run(1.5).mode is Mode.MANIPULATE
    assert (0x2001, 0, 2) in requests_to_tip(other)
    assert other.tips[0].slave._keeper.kept.objects != kept.objects


def test_a_fingertip_with_another_calibration_is_named_in_spite_of_its_signature(bench, table_4):
    config, hand = table_4
    rig = bench.VirtualBench(with_finger(config, calibration="0" * 16), hand)
    assert rig.run(1.5).mode is Mode.MANIPULATE
    kept = rig.tips[0].slave._keeper.kept
    rig.tips[0] = FingertipNode(TIP, MethodCode.CORRECTED, "f" * 16, kept=kept)
    rig.wake(TIP)
    assert f"2001h:00 is {'f' * 16!r}, expected {'0' * 16!r}" in rig.run(1.0).reason


def test_a_disk_that_takes_seconds_does_not_hold_up_the_start(bench, table_4):
    """The response to 1010h comes after the save; the host goes on after 200 ms."""

    def without_answer_to_save(stamp_us, frame):
        is_saved = frame.can_id == 0x580 + TIP and frame.data[:3] == b"\x60\x10\x10"
        return [] if is_saved else [(stamp_us, frame)]

    rig = bench.VirtualBench(*table_4, to_host=without_answer_to_save)
    assert rig.run(1.5).mode is Mode.MANIPULATE


def test_a_fingertip_without_a_signature_object_is_read_whole(rig, bench, monkeypatch):
    """As one of an earlier version."""

    def without_signature(path, node_id):
        od = load_eds(path, node_id)
        entries = {key: entry for key, entry in od.entries.items() if key[0] != SIGNATURE}
        return msgspec.structs.replace(od, entries=entries, indices=od.indices - {SIGNATURE})

    monkeypatch.setattr("palpate_edge.node.fingertip.load_eds", without_signature)
    rig.tips[0] = bench.make_tip(TIP)
    assert rig.run(1.5).mode is Mode.MANIPULATE
    assert len(requests_to_tip(rig)) == 44
